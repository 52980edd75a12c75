"""Series for viewers: those of the diagnosis, on one clock, with few enough rows."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.report.log_result import LogDiagnosis
from stiction_envs.gap.report.servo_result import ServoResult
from stiction_envs.gap.viewers import series
from stiction_envs.gap.viewers.series import PAUSE, common_time
from stiction_envs.measured.logs.reader import JointLog


def _log(*, date: float | None = None) -> JointLog:
    return JointLog(
        source="x.csv",
        t=np.arange(3.0),
        q=np.zeros((3, 1)),
        dq=None,
        tau=np.zeros((3, 1)),
        date=date,
    )


def test_simulated_torques_are_nominal_ones_with_all_causes(torques: LogDiagnosis) -> None:
    s = torques.series()
    assert (s.quantity, s.unit) == ("torque", "N·m")
    assert list(s.causes) == ["coulomb_friction"]
    # nothing but the cause was fitted here, so it is the whole difference
    small = [t for t in torques.diagnosis.terms if t.small or t.cause not in s.causes]
    assert small == []
    np.testing.assert_allclose(s.simulated - s.nominal, s.causes["coulomb_friction"], atol=1e-12)
    left = np.sqrt(np.mean((s.measured - s.simulated) ** 2, axis=0))
    np.testing.assert_allclose(left, torques.extended_rms, rtol=0.2)
    assert s.q_simulated is None


def test_angles_are_those_of_the_report_and_contact_is_marked(angles: ServoResult) -> None:
    s, d = angles.series(), angles.diagnosis
    assert (s.quantity, s.unit) == ("angle", "rad")
    np.testing.assert_array_equal(s.simulated, d.angles[0])
    np.testing.assert_array_equal(s.measured, d.logs[0].q)
    assert s.q_cmd is not None
    np.testing.assert_array_equal(s.q_cmd, d.logs[0].q_cmd)
    assert s.contact is not None
    begin, end = d.touching[0][0]
    assert s.contact[np.searchsorted(s.time, 0.5 * (begin + end))]
    assert not s.contact[np.searchsorted(s.time, begin) - 1]
    free = np.sqrt(np.mean((s.measured - s.simulated)[~s.contact] ** 2, axis=0))
    np.testing.assert_allclose(free, d.extended_rms, rtol=1e-6)


def test_the_words_hold_verdict_and_evidence(torques: LogDiagnosis, angles: ServoResult) -> None:
    for found in (torques, angles):
        text = found.series().text
        assert found.summary in text
        assert all(c.evidence in text for c in found.diagnosis.causes)


def test_a_long_log_loses_rows_and_says_so(
    angles: ServoResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = angles.series()
    monkeypatch.setattr(series, "ROWS", 400)
    few = angles.series()
    every = int(np.ceil(len(whole.time) / 400))
    assert every > 1
    assert len(few.time) <= 400
    np.testing.assert_array_equal(few.measured, whole.measured[::every])
    assert f"One row of {every} is in this file." in few.text
    assert "is in this file" not in whole.text


def test_logs_without_dates_follow_one_another() -> None:
    t, log = np.array([0.0, 1.0, 2.0, 0.0, 1.0, 2.0]), np.array([0, 0, 0, 1, 1, 1])
    time, date = common_time(t, log, [_log(), _log()])
    np.testing.assert_allclose(time, [0, 1, 2, 2 + PAUSE, 3 + PAUSE, 4 + PAUSE])
    assert date == 0.0


def test_dates_and_a_clock_that_runs_on_are_kept() -> None:
    t, log = np.array([0.0, 1.0, 0.0, 1.0]), np.array([0, 0, 1, 1])
    time, date = common_time(t, log, [_log(date=1000.0), _log(date=1060.0)])
    np.testing.assert_allclose(time, [0, 1, 60, 61])
    assert date == 1000.0
    time, _ = common_time(np.array([0.0, 1.0, 5.0, 6.0]), log, [_log(), _log()])
    np.testing.assert_allclose(time, [0, 1, 5, 6])
    # one date alone says nothing
    _, date = common_time(t, log, [_log(date=1000.0), _log()])
    assert date == 0.0
