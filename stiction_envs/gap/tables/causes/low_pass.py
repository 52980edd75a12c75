"""The cut-off of the robot's command filter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Cause
from stiction_envs.gap.tables.causes.simulated import SAME_DAY
from stiction_envs.gap.tables.data import Effect, TableData
from stiction_envs.gap.tables.whole_arm import Quantity

LOW_PASS = Quantity(
    name="low_pass", fields=("lowpass_hz",), of_interface=True, low=8.0, high=1000.0
)
"""Cut-off of a low-pass [Hz]; the range is assumed."""
LOG_SIZE = 0.7
"""Prior size of the logarithm of the cut-off [-]; assumed."""
GRID = 25
"""Number of cut-offs that are tried; assumed."""
OTHER_JOINTS = "the same dither on the other joints: a filter acts on all of them"


class LowPass(Cause):
    """One cut-off for the dither of all joints."""

    name = "low_pass"
    words = "a cut-off of {cutoff_hz:.3g} Hz"
    not_in_friction = "a low-pass of {cutoff_hz:.4g} Hz on the commanded torque is the interface's"
    tell_apart: ClassVar[Mapping[str, str]] = {
        "rotor_inertia": OTHER_JOINTS,
        "presliding": OTHER_JOINTS,
        "base_drift": SAME_DAY,
    }

    def in_tables(self, data: TableData) -> Iterator[Effect]:
        """Yield one effect on all joints."""
        neutral = data.whole.neutral(LOW_PASS)
        ends = np.log(np.array([LOW_PASS.low, LOW_PASS.high]) / neutral) / LOG_SIZE
        yield Effect(
            self.name,
            data.joints,
            np.arange(len(data.jobs)),
            size=LOG_SIZE,
            trials=tuple(x for x in np.linspace(ends[0], ends[1], GRID).tolist() if x),
            quantity=LOW_PASS,
            parameters={"cutoff_hz": neutral},
            log=True,
        )
