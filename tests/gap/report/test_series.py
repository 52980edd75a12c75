"""Series for viewers: those of the diagnosis, on one clock, as CSV and as Rerun reads them."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from stiction_envs.errors import StictionError
from stiction_envs.gap.report import series
from stiction_envs.gap.report.figures import draw_joint
from stiction_envs.gap.report.results import LogDiagnosis, ServoResult
from stiction_envs.gap.report.series import PAUSE, Series, common_time, skeleton
from stiction_envs.measured.logs.reader import JointLog, read_logs
from tests.gap.servo.small_arm import two_links


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
        simulated = d.data.nominal[:, j - 1] + d.torque(j - 1)  # small errors are in it too
        np.testing.assert_allclose(found["tau_simulated"], simulated, atol=1e-7)
        own = d.cause_torque("coulomb_friction")[:, j - 1]
        np.testing.assert_allclose(read[f"coulomb_friction{j}"], own, atol=1e-7)
        left = np.sqrt(np.mean((found["tau"] - found["tau_simulated"]) ** 2))
        assert left == pytest.approx(d.extended_rms[j - 1], rel=0.2)
    (log,) = read_logs([tmp_path / "series.csv"], 2)
    np.testing.assert_allclose(log.t, d.data.t, atol=1e-7)
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
    begin, end = d.touching[0][0]
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


# ---- pictures ----


def drawn(s: Series, joint: int, plots: Path) -> bytes:
    plots.mkdir(exist_ok=True)
    text = draw_joint(s, joint, plots)
    assert text.startswith(f"![joint {joint + 1}](plots/joint_{joint + 1}.png)")
    return (plots / f"joint_{joint + 1}.png").read_bytes()


def test_the_residual_leaves_out_contact_and_the_caption_says_so(
    tmp_path: Path, angles: ServoResult
) -> None:
    s = angles.series()
    free = replace(s, contact=np.zeros(len(s.time), dtype=bool))
    assert drawn(s, 1, tmp_path) != drawn(free, 1, tmp_path)
    assert "without contact" in draw_joint(s, 1, tmp_path)
    assert "contact" not in draw_joint(free, 1, tmp_path)


Array = NDArray[np.float64]


def recording(path: Path) -> dict[str, dict[str, Any]]:
    """Return the columns of each entity of a file as arrays, static ones as their first value."""
    out: dict[str, dict[str, Any]] = {}
    for chunk in RrdReader(path).stream():
        batch, of = chunk.to_record_batch(), out.setdefault(chunk.entity_path, {})
        for name in batch.schema.names[1:]:
            column = batch.column(name)
            if chunk.is_static:
                of[name] = column[0].as_py()
            elif name == "time":
                of[name] = np.append(of.get(name, ()), 1e-9 * column.cast("int64").to_numpy())
            else:
                of.setdefault(name, []).extend(column.to_pylist())
    return out


def lines(entity: dict[str, Any]) -> dict[str, Array]:
    """Return (T,) values of the lines of an entity by name."""
    values = np.array(entity["Scalars:scalars"]).T
    return dict(zip(entity["SeriesLines:names"], values, strict=True))


def test_torques_residuals_and_causes_are_those_of_the_series(
    tmp_path: Path, torques: LogDiagnosis
) -> None:
    s, read = torques.series(), recording(torques.write_rrd(tmp_path / "x.rrd"))
    np.testing.assert_allclose(read["/torque/joint_1"]["time"], s.time, atol=1e-9)
    models = {"nominal": s.nominal, "simulated": s.simulated}
    left = {name: s.measured - x for name, x in models.items()}
    groups = {"torque": {"measured": s.measured} | models, "residual": left, "cause": s.causes}
    for group, drawn in groups.items():
        for j in range(2):
            found = lines(read[f"/{group}/joint_{j + 1}"])
            assert list(found) == list(drawn)
            for name, values in drawn.items():
                np.testing.assert_array_equal(found[name], values[:, j])
    (text,) = read["/diagnosis"]["TextDocument:text"]
    assert torques.causes[0].evidence in text
    assert "one arm is drawn" in text
    assert "/arm/simulated" not in read


def test_angles_contact_and_both_arms_are_those_of_the_series(
    tmp_path: Path, angles: ServoResult
) -> None:
    s, read = angles.series(), recording(angles.write_rrd(tmp_path / "x.rrd"))
    for j in range(2):
        found = lines(read[f"/angle/joint_{j + 1}"])
        for name, values in (("measured", s.q), ("simulated", s.simulated), ("commanded", s.q_cmd)):
            np.testing.assert_array_equal(found[name], values[:, j])
    np.testing.assert_array_equal(lines(read["/contact"])["contact"], s.contact)
    assert s.contact.any()
    for name, q in (("measured", s.q), ("simulated", s.simulated)):
        strips = np.array(read[f"/arm/{name}"]["LineStrips3D:strips"])[:, 0]
        np.testing.assert_allclose(strips, skeleton(angles.arm, q), atol=1e-6)
        assert np.ptp(strips[:, -1], axis=0).max() > 0.01  # the flange moves


def test_what_cannot_be_written_is_refused(
    tmp_path: Path, torques: LogDiagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = tmp_path / "there.rrd"
    there.write_text("old")
    for path, says in (
        (tmp_path / "x.csv", "ends in '.csv': expected a path to a .rrd"),
        (tmp_path / "none" / "x.rrd", "none: expected an existing folder"),
        (there, "there.rrd: exists: choose another name, or force"),
    ):
        with pytest.raises(StictionError, match=re.escape(says)):
            torques.write_rrd(path)
    assert there.read_text() == "old"
    torques.write_rrd(there, force=True)
    assert there.read_bytes()[:4] == b"RRF2"
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(StictionError, match=re.escape("pip install 'stiction-envs[rerun]'")):
        torques.write_rrd(tmp_path / "x.rrd")
    assert list(tmp_path.iterdir()) == [there]


def test_an_arm_is_drawn_where_it_is(tmp_path: Path) -> None:
    """Two links that lie flat, then the second hanging down."""
    drawn = skeleton(two_links(tmp_path), np.array([[0.0, 0.0], [0.0, np.pi / 2]]))
    np.testing.assert_allclose(drawn[:, 1:3], 2 * [[[0.0, 0.0, 1.0], [0.3, 0.0, 1.0]]], atol=1e-9)
    flange = drawn[:, -1] - drawn[:, 2]
    np.testing.assert_allclose(flange[1], flange[0][[2, 1, 0]] * [1, 1, -1], atol=1e-9)
