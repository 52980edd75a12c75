"""Friction that falls or rises with time: τ = r t sign(q̇).

Logs of one session share the time t since it began; logs that are days apart each start cold.
Where the clocks allow both, both are tried, and the data choose.
"""

from typing import ClassVar

import numpy as np

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Prior, Shape, View
from stiction_envs.gap.causes.draft import LATE, LEAST_FRICTION, ModelDraft, Part
from stiction_envs.gap.causes.friction.coulomb_friction import CoulombFriction
from stiction_envs.gap.signals.dataset import Data

OF_LOG, OF_SESSION = 0.0, 1.0
"""Nonlinear parameter: time counts since the log began, or since the session."""


def _time(data: Data, shape: Shape) -> Array:
    """Return (T,) time since each log began, or its session [s].

    Where these were the same, it is the session's: a later log may continue it.
    """
    recording = data.recording
    return recording.since_log if shape == (OF_LOG,) else recording.since_session


class WarmUpDrift(Cause):
    """Dry friction that changes along the log, as a gear that warms up."""

    name: ClassVar[str] = "warm_up_drift"
    what: ClassVar[str] = "friction falls or rises with time or temperature"
    filtered: ClassVar[bool] = False
    what_to_record: ClassVar[str] = (
        "the same motion repeated for tens of minutes, from cold, on one clock"
    )
    needs: ClassVar = (CoulombFriction.name,)
    parameters: ClassVar = (Parameter("drift_nm_per_s", "N·m/s"),)
    view: ClassVar = View(
        "time [s]",
        lambda data, joint, shape: _time(data, shape),
        folded=True,
        note="friction changes along the log",
    )

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return a fiftieth of what the joint can bear, over the time [N·m/s]; assumed."""
        seconds = max(float(np.ptp(_time(data, shape))), 1.0)
        return Prior(np.array([0.02 * data.strength[joint] / seconds]))

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return time in the direction of motion."""
        return data.growth(joint, _time(data, shape))[:, None]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return since when time may count; no choice where logs and sessions begin together."""
        recording = data.recording
        same = np.array_equal(recording.since_log, recording.since_session)
        return [()] if same else [(OF_LOG,), (OF_SESSION,)]

    def describe(self, data: Data, coefficients: Array, shape: Shape) -> str:
        """Return since when time counts, where there are several logs."""
        if shape:
            both = ("the session", "each log")
            this, other = both if shape == (OF_SESSION,) else both[::-1]
            return (
                f"{self.what} (with the time since {this} began, which fits better than the time "
                f"since {other} began)"
            )
        if len(np.unique(data.recording.log)) < 2:
            return self.what
        common = data.recording.sessions.common_clock
        why = "their pauses are long" if common else "no clock is common"
        return f"{self.what} (each log is assumed to start cold: {why})"

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Write the drift as the start of a slow exponential, if friction stays positive."""
        j, rate = part.joint - 1, float(part.coefficients[0])
        late = LATE * draft.duration
        level = float(draft.coulomb[j].mean())
        warm = level + rate * late
        rise = -rate * late / warm if warm > LEAST_FRICTION < level else -1.0
        ok = rise > -0.9 and draft.values["warm_up_friction"][j] == 0
        when = "mid-record" if ok else "the start of the record"
        stands = rate * draft.duration / 2 if ok else 0.0
        why = f"MJCF has no clock: the level at {when} stands"
        draft.leave_out(part, why, tables=not ok, dry=stands)
        if ok:
            draft.values["warm_up_friction"][j] = rise
            draft.values["warm_up_time"][j] = late
            draft.coulomb[j] *= warm / level
            draft.values["stiction"][j] *= warm / level
