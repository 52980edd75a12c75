"""What was found in torque tables: causes, their parameters, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.judge.judgement import Estimate, Judgement, percent_gained
from stiction_envs.gap.tables.model import Fit
from stiction_envs.gap.tables.readings import TableData

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class TableDiagnosis(Judgement):
    """What the tables show about the simulation."""

    joints: tuple[int, ...]
    """The joints with dithered torques in the tables."""
    nominal: Array
    """Mean |error| of the nominal simulation in each, over the joint's friction [%]."""
    extended: Array
    """The same with the causes, each block predicted from the others [%]."""
    noise_floor: Array
    """Standard deviation of a reading, over the joint's friction [%]; NaN if unknown."""
    reason: str = ""
    """Why the tables are not, or not fully, explained; empty otherwise."""

    @property
    def gain_percent(self) -> float:
        """See `Judgement.gain_percent`."""
        return percent_gained(self.nominal, self.extended) if self.causes else 0.0

    def to_json(self) -> dict[str, object]:
        """Return the contents of a `diagnosis.json`; joints are strings, NaN is None."""

        def by_joint(values: Array) -> dict[str, float | None]:
            each = zip(self.joints, values.tolist(), strict=True)
            return {str(j): x if math.isfinite(x) else None for j, x in each}

        return {
            "robot": self.robot,
            "verdict": self.verdict,
            "reason": self.reason,
            "joints": list(self.joints),
            "nominal": {"error_percent": by_joint(self.nominal)},
            "extended": {"error_percent": by_joint(self.extended), "held_out": True},
            "noise_floor_percent": by_joint(self.noise_floor),
            "gain_percent": self.gain_percent,
            **self.judged_json(),
        }


def parameters_of(fits: Sequence[Fit], data: TableData) -> dict[str, Estimate]:
    """Return the parameters of a cause from the fits of its hypotheses."""
    out = {}
    for fit in fits:
        h, cause = fit.hypothesis, fit.hypothesis.cause
        value, low, high = (
            float(np.exp(v)) if cause.logarithmic else float(v) for v in (fit.x, fit.low, fit.high)
        )
        estimate = Estimate(value=value, ci95=(low, high), on_bound=fit.on_bound)
        alone = len(fits) == 1 and len(h.where) > 2
        out[cause.parameter if alone else f"{cause.parameter} {h.scope}"] = estimate
        out |= cause.more_parameters(estimate, h.joints[0], data)
    return out
