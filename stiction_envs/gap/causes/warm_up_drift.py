"""Friction that falls or rises with time: τ = r t sign(q̇)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, constants
from stiction_envs.gap.causes.coulomb_friction import CoulombFriction
from stiction_envs.gap.causes.draft import LATE, LEAST_FRICTION, ModelDraft
from stiction_envs.gap.causes.motion import lacks_both_directions
from stiction_envs.gap.causes.part import Part
from stiction_envs.gap.causes.view import View
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.method_settings import check_numbers


@dataclass(frozen=True, kw_only=True)
class WarmUpDriftSettings:
    """When a drift can be seen."""

    shortest_log: float
    """In which it is looked for [s]."""

    def __post_init__(self) -> None:
        check_numbers(self)


class WarmUpDrift(Cause):
    """Dry friction that changes along the log, as a gear that warms up."""

    name: ClassVar[str] = "warm_up_drift"
    settings: WarmUpDriftSettings = constants(WarmUpDriftSettings, name)
    what: ClassVar[str] = "friction falls or rises with time or temperature"
    approximate: ClassVar[bool] = True
    what_to_record: ClassVar[str] = "the same motion repeated for tens of minutes, from cold"
    needs: ClassVar = (CoulombFriction.name,)
    parameters: ClassVar = (Parameter("drift_nm_per_s", "N·m/s"),)
    view: ClassVar = View(
        "time [s]",
        lambda data, joint, shape: data.t,
        folded=True,
        note="friction changes along the log",
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return time in the direction of motion, on the clock of the log."""
        return data.smooth(data.growth(joint, data.t))[:, None]

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return r [N·m/s]."""
        return {"drift_nm_per_s": float(coefficients[0])}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Write the drift as the start of a slow exponential, if friction stays positive."""
        j, rate = part.joint - 1, float(part.coefficients[0])
        late = LATE * draft.duration
        level = float(draft.coulomb[j].mean())
        warm = level + rate * late
        rise = -rate * late / warm if warm > LEAST_FRICTION < level else -1.0
        ok = rise > -0.9 and draft.warm[j, 0] == 0
        when = "mid-record" if ok else "the start of the record"
        draft.leave_out(part, f"MJCF has no clock: the level at {when} stands", tables=not ok)
        if ok:
            draft.warm[j] = rise, late
            draft.coulomb[j] *= warm / level
            draft.stiction[j] *= warm / level

    def contribution_order(self, part: Part) -> tuple[int, float]:
        """Return last: it needs the level it drifts from."""
        return 2, 0.0

    def held(self, draft: ModelDraft, part: Part, data: Data) -> Array | None:
        """Return the level half-way through the logs."""
        j = part.joint - 1
        if draft.warm[j, 0] == 0:
            return None
        return part.coefficients[0] * (draft.duration / 2) * data.smooth(data.direction(j))

    def why_not_identifiable(self, data: Data, joint: int) -> str:
        """Return whether the log is too short."""
        if np.ptp(data.t) < self.settings.shortest_log:
            return f"the record is only {np.ptp(data.t):.1f} s long"
        return lacks_both_directions(data, joint)
