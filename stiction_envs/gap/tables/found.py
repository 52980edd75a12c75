"""What was found in torque tables: causes, their parameters, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction_envs.gap.estimates import Estimate
from stiction_envs.gap.tables.model import Fit
from stiction_envs.gap.tables.readings import TableData


@dataclass(frozen=True, kw_only=True)
class FoundTableCause:
    """One thing that the simulation gets wrong."""

    name: str
    joints: tuple[int, ...]
    parameters: dict[str, Estimate]
    gain_percent: float
    """Share of the held-out error, mean over joints, that returns without this cause [%]."""
    evidence: str
    """One sentence that can be checked in the table."""
    confused_with: dict[str, str]
    """Causes that these tables cannot distinguish from it, and the measurement that would."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units of the parameters."""

    def to_json(self) -> dict[str, Any]:
        """Return an entry of `diagnosis.json`."""
        return {
            "name": self.name,
            "joints": list(self.joints),
            "gain_percent": self.gain_percent,
            "parameters": {
                k: {"value": p.value, "ci95": list(p.ci95), "on_bound": p.on_bound}
                for k, p in self.parameters.items()
            },
            "evidence": self.evidence,
            "confused_with": list(self.confused_with),
            "told_apart_by": dict(self.confused_with),
        }


@dataclass(frozen=True, kw_only=True)
class TableDiagnosis:
    """What the tables show about the simulation."""

    robot: str
    verdict: str
    """``explained``, ``partly explained``, ``no discrepancy`` or ``cannot tell``."""
    causes: tuple[FoundTableCause, ...] = ()
    """Strongest first."""
    joints: tuple[int, ...]
    """The joints with dithered torques in the tables."""
    nominal: dict[int, float]
    """Mean |error| of the nominal simulation per joint, over the joint's friction [%]."""
    extended: dict[int, float]
    """The same with the causes, each block predicted from the others [%]."""
    noise_floor: dict[int, float]
    """Standard deviation of a reading, over the joint's friction [%]; NaN if unknown."""
    gain_percent: float = 0.0
    """100 (1 − mean over joints of extended over nominal) [%]."""
    reason: str = ""
    """Why the tables are not, or not fully, explained; empty otherwise."""

    def to_json(self) -> dict[str, Any]:
        """Return the contents of a `diagnosis.json`; joints are strings, NaN is None."""

        def by_joint(values: Mapping[int, float]) -> dict[str, float | None]:
            return {str(j): v if math.isfinite(v) else None for j, v in values.items()}

        return {
            "robot": self.robot,
            "verdict": self.verdict,
            "reason": self.reason,
            "joints": list(self.joints),
            "nominal": {"error_percent": by_joint(self.nominal)},
            "extended": {"error_percent": by_joint(self.extended), "held_out": True},
            "noise_floor_percent": by_joint(self.noise_floor),
            "gain_percent": self.gain_percent,
            "causes": [cause.to_json() for cause in self.causes],
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
