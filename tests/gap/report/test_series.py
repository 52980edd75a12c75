"""Series of a diagnosis, on one clock, as CSV and as pictures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.gap.report import series
from stiction_envs.gap.report.figures import draw_joint
from stiction_envs.gap.report.results import LogDiagnosis, ServoResult
from stiction_envs.gap.report.series import PAUSE, common_time
from stiction_envs.measured.logs.reader import JointLog, read_logs


def _columns(path: Path) -> dict[str, np.ndarray]:
    table = np.genfromtxt(path, delimiter=",", names=True)
    return {name: table[name] for name in table.dtype.names}


def test_a_joint_log_s_series_are_measured_torques_models_and_causes(
    tmp_path: Path, torques: LogDiagnosis
) -> None:
    """The series are a joint log again."""
    (tmp_path / "series.csv").write_text(torques.series().csv())
    read, d = _columns(tmp_path / "series.csv"), torques.diagnosis
    for j in (1, 2):
        found = {name: read[f"{name}{j}"] for name in ("tau", "tau_nominal", "tau_simulated")}
        np.testing.assert_allclose(found["tau"], d.data.tau[:, j - 1], atol=1e-7)
        np.testing.assert_allclose(found["tau_nominal"], d.data.nominal[:, j - 1], atol=1e-7)
        simulated = d.data.nominal[:, j - 1] + d.torque[:, j - 1]  # small errors are in it too
        np.testing.assert_allclose(found["tau_simulated"], simulated, atol=1e-7)
        own = d.cause_torque("coulomb_friction")[:, j - 1]
        np.testing.assert_allclose(read[f"coulomb_friction{j}"], own, atol=1e-7)
        left = np.sqrt(np.mean((found["tau"] - found["tau_simulated"]) ** 2))
        assert left == pytest.approx(d.extended_rms[j - 1], rel=0.2)
    (log,) = read_logs([tmp_path / "series.csv"], 2)
    np.testing.assert_allclose(log.t, d.data.recording.t, atol=1e-7)
    np.testing.assert_allclose(log.q, d.data.q, atol=1e-7)
    np.testing.assert_allclose(log.tau, d.data.tau, atol=1e-7)


def test_a_servo_log_s_series_are_commands_angles_and_contact(
    tmp_path: Path, angles: ServoResult
) -> None:
    (tmp_path / "series.csv").write_text(angles.series().csv())
    read, d = _columns(tmp_path / "series.csv"), angles.diagnosis
    touches = read["contact"].astype(bool)
    for j in (1, 2):
        np.testing.assert_allclose(read[f"q{j}"], d.logs[0].q[:, j - 1], atol=1e-8)
        np.testing.assert_allclose(read[f"q_cmd{j}"], d.logs[0].q_cmd[:, j - 1], atol=1e-8)
        free = (read[f"q{j}"] - read[f"q_simulated{j}"])[~touches]
        assert np.sqrt(np.mean(free**2)) == pytest.approx(d.extended_rms[j - 1], rel=1e-5)
    begin, end = d.logs[0].t[d.touched[0]][[0, -1]]
    assert touches[np.searchsorted(read["t"], 0.5 * (begin + end))]
    assert not touches[np.searchsorted(read["t"], begin) - 1]


def test_a_long_log_loses_rows(angles: ServoResult, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = angles.series()
    monkeypatch.setattr(series, "ROWS", 400)
    few = angles.series()
    every = int(np.ceil(len(whole.time) / 400))
    assert every > 1
    assert len(few.time) <= 400
    np.testing.assert_array_equal(few.measured, whole.measured[::every])


def test_logs_without_dates_follow_one_another() -> None:
    t, log = np.array([0.0, 1.0, 2.0, 0.0, 1.0, 2.0]), np.array([0, 0, 0, 1, 1, 1])
    zeros = np.zeros((3, 1))
    one = JointLog(source="x.csv", t=np.arange(3.0), q=zeros, dq=None, tau=zeros)
    time = common_time(t, log, [one, one])
    np.testing.assert_allclose(time, [0, 1, 2, 2 + PAUSE, 3 + PAUSE, 4 + PAUSE])


def test_the_residual_leaves_out_contact_and_the_caption_says_so(
    tmp_path: Path, angles: ServoResult
) -> None:
    s, pictures = angles.series(), set()
    for one, said in ((s, True), (replace(s, contact=np.zeros(len(s.time), bool)), False)):
        text = draw_joint(one, 1, tmp_path)
        assert text.startswith("![joint 2](plots/joint_2.png)")
        assert ("without contact" in text) == said
        pictures.add((tmp_path / "joint_2.png").read_bytes())
    assert len(pictures) == 2
