"""Friction that drifts over several logs: of one session, or each from cold."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.measured.logs.reader import JointLog
from tests.gap.small_logs import RATE, hidden, panda, sliding

ARM = panda()
JOINT = 3
"""From 0."""
DATE = 1.7e9
CAUSES = [cause_named(x) for x in ("coulomb_friction", "viscous_friction", "warm_up_drift")]
LOGS = 3
PAUSE = 120.0
SLOW, QUICK = -0.002, -0.02
"""Drift over a session, and over a log [N·m/s]."""


def logs(begin: list[float], pause: float, drift: float, *, dates: bool = False) -> list[JointLog]:
    """Logs ``pause`` [s] apart whose clocks begin so; joint 4 rubs by 1 N·m at first."""
    out = []
    for k, start in enumerate(begin):

        def rub(q, dq, ddq, k=k):
            torque = 0.5 * sliding(q)
            torque[:, JOINT] *= 2 * (1 + drift * (pause * k + np.arange(len(q)) / RATE))
            return torque

        log = hidden(ARM, rub, noise=0.05, seconds=15.0, seed=k + 1)
        t = log.t if dates else log.t + start
        date = start if dates else None
        out.append(dataclasses.replace(log, source=f"{k}.csv", t=np.array(t), date=date))
    return out


def found(some: list[JointLog]) -> tuple[Diagnosis, list[float], list[float], str]:
    """Drift of joint 4 [N·m/s] and friction when it starts [N·m], each as an interval."""
    d = diagnose_logs(some, ARM, causes=CAUSES)
    named = {c.name: c for c in d.causes}
    assert named["warm_up_drift"].joints == (JOINT + 1,)
    drift = named["warm_up_drift"].parameters[JOINT + 1]["drift_nm_per_s"]
    level = named["coulomb_friction"].parameters[JOINT + 1]["coulomb_nm"]
    return d, drift.ci95, level.ci95, named["warm_up_drift"].evidence


@pytest.mark.parametrize(("begin", "dates"), [(5000.0, False), (DATE, True)])
def test_logs_of_one_session_drift_as_one(begin: float, dates: bool) -> None:
    """Times that rise from log to log, wherever they begin, and dates."""
    starts = [begin + PAUSE * k for k in range(LOGS)]
    _, (low, high), level, evidence = found(logs(starts, PAUSE, SLOW, dates=dates))
    assert low < SLOW < high
    assert high - low < 0.2 * abs(SLOW)
    assert level[0] < 1.0 < level[1]
    assert "since the session began, which fits better" in evidence


@pytest.mark.parametrize(
    ("starts", "dates", "why"),
    [
        ([0.0] * LOGS, False, "assumed to start cold: no clock is common"),
        ([DATE + 86400 * k for k in range(LOGS)], True, "assumed to start cold: their pauses"),
        # clocks of two boots may happen to rise
        ([100.0, 900.0, 2500.0], False, "since each log began, which fits better"),
    ],
)
def test_logs_that_start_cold_drift_each_by_itself(starts, dates, why) -> None:
    _, (low, high), level, evidence = found(logs(starts, 0.0, QUICK, dates=dates))
    assert low < QUICK < high
    assert high - low < 0.2 * abs(QUICK)
    assert level[0] < 1.0 < level[1]
    assert why in evidence
