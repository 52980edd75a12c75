"""Friction that drifts over several logs: of one session, or each from cold."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.measured.logs.reader import JointLog
from tests.gap.small_logs import RATE, hidden, panda, sliding

ARM = panda()
JOINT = 3
"""From 0."""
DATE, DAY = 1.7e9, 86400.0
SESSION = "since the session began, which fits better"
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


@pytest.mark.parametrize(
    ("starts", "pause", "drift", "dates", "why"),
    [
        # one session: times that rise from log to log, wherever they begin, and dates
        ([5000.0 + PAUSE * k for k in range(LOGS)], PAUSE, SLOW, False, SESSION),
        ([DATE + PAUSE * k for k in range(LOGS)], PAUSE, SLOW, True, SESSION),
        # each log starts cold
        ([0.0] * LOGS, 0.0, QUICK, False, "assumed to start cold: no clock is common"),
        ([DATE + DAY * k for k in range(LOGS)], 0.0, QUICK, True, "start cold: their pauses"),
        # clocks of two boots may happen to rise
        ([100.0, 900.0, 2500.0], 0.0, QUICK, False, "since each log began, which fits better"),
    ],
)
def test_logs_drift_as_one_session_or_each_from_cold(starts, pause, drift, dates, why) -> None:
    found = diagnose_logs(logs(starts, pause, drift, dates=dates), ARM, causes=CAUSES)
    named = {c.name: c for c in found.causes}
    assert named["warm_up_drift"].joints == (JOINT + 1,)
    low, high = named["warm_up_drift"].parameters[JOINT + 1]["drift_nm_per_s"].ci95
    assert low < drift < high
    assert high - low < 0.2 * abs(drift)
    low, high = named["coulomb_friction"].parameters[JOINT + 1]["coulomb_nm"].ci95
    assert low < 1.0 < high
    assert why in named["warm_up_drift"].evidence
