"""Dry friction that is off by one factor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import numpy as np

from stiction_envs.experiments.sje.calibrate import with_levels
from stiction_envs.experiments.sje.poses import Poses
from stiction_envs.experiments.sje.protocol import LOADS
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.gap.tables.causes.base import (
    BASE_AGAIN,
    Array,
    Hypothesis,
    Index,
    TableCause,
    Wheres,
)
from stiction_envs.gap.tables.readings import Comparison, TableData
from stiction_envs.gap.tables.whole_arm import FRICTION_LEVEL
from stiction_envs.reporting.markdown import joints


class FrictionLevel(TableCause):
    """Base and dithered torques are off by one factor, in both poses or in one."""

    name, parameter = "friction_level", "factor"
    repeatable = True
    tell_apart: ClassVar[Mapping[str, str]] = {"base_drift": BASE_AGAIN}

    def statements(self, wheres: Mapping[int, Wheres]) -> Iterator[Hypothesis]:
        """Yield hypotheses about both poses and about each."""
        for some in wheres.values():
            yield Hypothesis(self, some)
            for load in LOADS:
                yield Hypothesis(self, tuple(w for w in some if w.load == load))

    def span(self, data: TableData, where: Wheres) -> tuple[float, float]:
        """Return the range of the logarithm of the factor."""
        return float(np.log(FRICTION_LEVEL.low)), float(np.log(FRICTION_LEVEL.high))

    def level(self, data: TableData, rows: Index, x: Array) -> Array | None:
        """Return the logarithm of the factor."""
        return x[:, None] * np.ones(len(rows))

    def evidence(self, some: Sequence[Hypothesis], x: Sequence[float], seen: Comparison) -> str:
        """Return the range of the dithered torques' error, and that of the base torques."""
        return "; ".join(_off(h, seen) for h in some)

    def in_friction(
        self, friction: FrictionParameters, poses: Poses, j: int, values: Mapping[str, float]
    ) -> dict[str, Array | float]:
        """Return friction in both poses with it."""
        scopes = ([f"factor {load}", "factor", "factor both poses"] for load in LOADS)
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


def _off(h: Hypothesis, seen: Comparison) -> str:
    r, rows = seen.data.readings, seen.data.readings.of(h.where)
    off = 100 * (r.torque - seen.without) / seen.data.unit
    dithered, base = off[rows & ~r.base], off[rows & r.base]
    low, high = np.percentile(dithered, [10, 90])
    return (
        f"{joints(h.joints)} {h.scope}: eight of ten of the {len(dithered)} dithered torques "
        f"are {low:+.1f} to {high:+.1f} % of the friction off the simulation (median "
        f"{np.median(dithered):+.1f} %), the base torques {base.mean():+.1f} %"
    )
