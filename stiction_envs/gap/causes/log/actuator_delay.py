"""Torque that acts late: τ(t) = dynamics(t + T), so that the residual is τ(t + T) − τ(t).

`delay_s` is T: positive where torque acts after it was logged, negative where it was measured late,
or behind a filter.
"""

import copy
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from stiction_envs.filters import lagging
from stiction_envs.gap.causes.base import THE_ARM, Array, Cause, Parameter, Prior, Shape, View
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data

LEAST = 0.001
"""Shortest delay that counts [s]; assumed: a robot's cycle."""
TRIED = (-0.002, -0.01, -0.02, -0.04, 0.002, 0.01, 0.02, 0.04)
"""T' to try [s]; assumed."""
LOWPASS_PARTS = (0.5, 1.0)
"""Second number of a shape whose torques were low-passed before they were logged: the part of |T'|
that is the low-pass's time constant; the rest is a delay [-]; assumed."""
SMOOTHED = (0.01, 0.02, 0.04, 0.08)
"""|T'| of low-passed torques to try [s]; assumed."""


class ActuatorDelay(Cause):
    """A delay or filter between the logged torque and the arm, one for all joints.

    It shifts all torque in time, that of the other causes too, which are not known at first. The
    search finds it on the nominal torque, then again as one that acts on all of the model's torque.
    """

    name: ClassVar[str] = "actuator_delay"
    what: ClassVar[str] = "torque acts late or filtered"
    is_linear: ClassVar[bool] = False
    what_to_record: ClassVar[str] = "fast motion of large torque, all channels stamped by one clock"
    acts_on: ClassVar[str] = THE_ARM
    parameters: ClassVar = (Parameter("delay_s", "s", -0.2, 0.2),)
    view: ClassVar = View(
        "rate of the nominal torque [N·m/s]",
        lambda data, joint, shape: data.rate(data.nominal[:, joint]),
        note="a slope: torque that comes late",
    )

    _torque: Array | None = None
    """(T, n) torque that acts late [N·m]; None for that of the nominal model."""
    _further: tuple[float, ...] = ()
    """Further T' to try [s]."""

    @property
    def acts_on_all(self) -> bool:
        """True if the delay shifts the torque of `acting_on`, not only the nominal torque."""
        return self._torque is not None

    def acting_on(self, torque: Array, lengths: Sequence[float] = ()) -> "ActuatorDelay":
        """Return a delay of a torque (T, n) [N·m] that also tries ``lengths`` [s]."""
        out = copy.copy(self)
        out._torque, out._further = torque, (*self._further, *lengths)
        return out

    def shifted(self, data: Data, torque: Array, shape: Shape) -> Array:
        """Return (T,) [τ(t + T') − τ(t)]/T' of a torque τ (T,), per second.

        τ(t + T') is later in time, or behind a low-pass too (`LOWPASS_PARTS`).
        """
        ahead, part, recording = shape[0], (*shape, 0.0)[1], data.recording
        torque = recording.along_path(torque)
        out = np.zeros_like(torque)
        for run in recording.path_runs:
            if run.stop - run.start <= 2:
                continue
            later, t = torque[run], recording.path_dt * np.arange(run.stop - run.start)
            if part < 1.0:
                later = np.interp(t + (1 - part) * ahead, t, later)
            if part > 0.0:
                k = np.exp(recording.path_dt / (part * ahead))
                later = lagging(later[:, None], k)[:, 0]
            out[run] = (later - torque[run]) / ahead
        return out[recording.path_rows]

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return two cycles of a slow controller [s]; assumed."""
        return Prior(np.array([0.02]))

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return `shifted` of the torque, for a T' near T."""
        torque = data.nominal if self._torque is None else self._torque
        if self._torque is None and data.carried is not None:
            torque = torque + data.carried
        each = [self.shifted(data, torque[:, j], shape) for j in range(data.n)]
        return np.stack(each, axis=1)[..., None]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return T' [s], positive and negative."""
        found = [-x for x in self._further if x < 0 and x not in TRIED]
        return [
            *((x,) for x in (*TRIED, *self._further)),
            *((-x, part) for part in LOWPASS_PARTS for x in (*SMOOTHED, *found)),
        ]

    def possible(
        self, data: Data, joint: int, coefficients: Array, shape: Shape, level: float
    ) -> bool:
        """Return whether the delay counts: `LEAST`, and half of the sampling time."""
        delay = abs(float(coefficients[0]))
        usual = super().possible(data, joint, coefficients, shape, level)
        return usual and delay >= max(LEAST, 0.5 * data.dt)

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Say by how much to shift torques: MuJoCo's actuators have no delay."""
        delay = part.coefficients[0]
        what = "send torques" if delay >= 0 else "take measured torques as of"
        behind = ", which come behind a low-pass" if len(part.shape) > 1 else ""
        draft.leave_out(part, f"{what} {abs(delay):.4g} s earlier{behind}")

    def describe(self, data: Data, coefficients: Array, shape: Shape) -> str:
        """Return whether torque acts after it was logged, or was logged after it acted."""
        if coefficients[0] >= 0:
            return self.what
        return "torque is late in the log (measured late, or behind a filter)"
