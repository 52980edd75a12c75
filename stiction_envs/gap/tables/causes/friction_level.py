"""Dry friction that is off by one factor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.sje.calibrate import with_levels
from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.experiments.sje.protocol import LOADS
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.causes.base import BASE_AGAIN, Array, Hypothesis, TableCause
from stiction_envs.gap.tables.readings import Readings, TableData
from stiction_envs.gap.tables.whole_arm import FRICTION_LEVEL

BOTH = "both poses"


class FrictionLevel(TableCause):
    """Base and dithered torques are off by one factor, in both poses or in one."""

    name, parameter = "friction_level", "factor"
    log_size = 0.15
    """Prior size of the factor's logarithm [-]; assumed: what temperature and wear change."""
    tell_apart: ClassVar[Mapping[str, str]] = {"base_drift": BASE_AGAIN}

    def hypotheses(self, readings: Readings) -> Iterator[Hypothesis]:
        """Yield hypotheses about both poses and about each."""
        for h in super().hypotheses(readings):
            yield Hypothesis(self, h.joints, h.rows, BOTH)
            for load in LOADS:
                rows = tuple(i for i in h.rows if readings.all[i].where.load == load)
                yield Hypothesis(self, h.joints, rows, load)

    def size(self, data: TableData, h: Hypothesis) -> float:
        """Return the size of the factor's logarithm."""
        return self.log_size

    def bounds(self, data: TableData, h: Hypothesis) -> tuple[float, float]:
        """Return the range of the logarithm of the factor."""
        return float(np.log(FRICTION_LEVEL.low)), float(np.log(FRICTION_LEVEL.high))

    def level(self, data: TableData, h: Hypothesis, x: float) -> Array | float | None:
        """Return the logarithm of the factor."""
        return x

    def values(self, data: TableData, h: Hypothesis, x: float) -> dict[str, float]:
        """Return the factor, named by the pose if it is one."""
        return {self.parameter if h.scope == BOTH else f"factor {h.scope}": float(np.exp(x))}

    def what(self, values: Mapping[str, float]) -> str:
        """Return the factors in words."""
        return "dry friction times " + ", ".join(
            f"{v:.3g} {k.removeprefix('factor')}".strip() for k, v in values.items()
        )

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return friction in both poses with it."""
        scopes = ([f"factor {load}", "factor"] for load in LOADS)
        factors = np.array([np.prod([values[k] for k in x if k in values]) for x in scopes])
        if factors[0] == factors[1]:
            names = ("stiction", "load_coefficient")
            return {k: getattr(friction, k)[j] * factors[0] for k in names}
        both = [friction.stiction_at(poses.load[:, k]).mean(axis=1) for k in range(len(LOADS))]
        level = np.stack(both, axis=1)
        level[j] *= factors
        offset = friction.offset[:, None] + friction.gravity_error[:, None] * poses.signed
        line = with_levels(friction, poses, level, offset)
        names_of_line = ("stiction", "load_coefficient", "load_low", "load_high")
        return {k: getattr(line, k)[j] for k in names_of_line}
