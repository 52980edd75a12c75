"""A drive whose logged torque falls with speed: friction would drive the joint."""

from __future__ import annotations

import numpy as np

from stiction_envs.gap.diagnosis import diagnose_logs
from tests.gap.small_logs import hidden, panda, sliding

SLOPE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.4, 0.0])


def test_torque_that_falls_with_speed_is_no_friction() -> None:
    log = hidden(panda(), lambda q, dq, ddq: 0.5 * sliding(q) - SLOPE * dq, noise=0.02)
    found = {c.name: c for c in diagnose_logs([log], panda()).causes}
    assert set(found) == {"coulomb_friction", "falling_torque"}
    assert found["falling_torque"].joints == (6,)
    low, high = found["falling_torque"].parameters[6]["slope_nms"].ci95
    assert low < SLOPE[5] < high
    assert high - low < 0.1
