"""Torque that acts late: τ(t) = dynamics(t + T), so that the residual is τ(t + T) − τ(t).

A log whose torque was measured late, or behind a filter, shows the same with T < 0: what is told is
|T| in both cases, and in words which it is.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from scipy.signal import lfilter

from stiction_envs.gap.causes.base import Array, Parameter, Shape, TorqueShift
from stiction_envs.gap.causes.draft import ModelDraft
from stiction_envs.gap.causes.part import Part
from stiction_envs.gap.causes.view import View
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import rate

LEAST = 0.001
"""Shortest delay that is called one [s]: a robot's cycle."""
DELAYS = (0.002, 0.01, 0.02, 0.04)
"""|T'| that are tried, both ways [s]."""
LOWPASS_PARTS = (0.5, 1.0)
"""Second number of a shape whose torques were low-passed before they were logged: the part of |T'|
that is the low-pass's time constant; the rest is a delay [-]."""
SMOOTHED = (0.01, 0.02, 0.04, 0.08)
"""|T'| of these that are tried [s]."""
LONGEST = 0.125
"""Longest |T'| that is looked for [s]: what is longer has taken the motion away."""
STEPS = (0.8, 0.9, 0.999999, 1.1, 1.2)
"""Factors of T' that are tried with another torque, one of them as good as none [-]. No two undo
each other, since a candidate has its columns once."""
TRIED = tuple(sign * x for sign in (-1.0, 1.0) for x in DELAYS)
"""T' that are tried [s]."""


def shifted(data: Data, torque: Array, shape: Shape) -> Array:
    """Return (T,) [τ(t + T') − τ(t)]/T' of a torque τ (T,), per second.

    τ(t + T') is that of a time, or behind a low-pass too (`LOWPASS_PARTS`).
    """
    ahead, out = shape[0], np.zeros(len(data.t))
    part = shape[1] if len(shape) > 1 else 0.0
    for run in data.runs():
        if run.stop - run.start <= 2:
            continue
        later = torque[run]
        if part < 1.0:
            later = np.interp(data.t[run] + (1 - part) * ahead, data.t[run], later)
        if part > 0.0:
            k = np.exp(data.dt / (part * ahead))
            later = lfilter([1 - k], [1, -k], later, zi=[k * later[0]])[0]
        out[run] = (later - torque[run]) / ahead
    return out


class ActuatorDelay(TorqueShift):
    """A delay or filter between the logged torque and the arm, one for all joints."""

    name: ClassVar[str] = "actuator_delay"
    what: ClassVar[str] = "torque acts late or filtered"
    is_linear: ClassVar[bool] = False
    what_to_record: ClassVar[str] = "fast motion of large torque, all channels stamped by one clock"
    arm_wide: ClassVar[bool] = True
    parameters: ClassVar = (Parameter("delay_s", "s", -0.2, 0.2),)
    view: ClassVar = View(
        "rate of the nominal torque [N·m/s]",
        lambda data, joint, shape: rate(data.nominal[:, joint], data.runs(), data.dt),
        note="a slope: torque that comes late",
    )

    _torque: Array | None = None
    """(T, n) that acts late [N·m]; None for what is known of it."""
    _further: tuple[float, ...] = ()
    """T' that are tried too [s]."""

    @property
    def acts_on_all(self) -> bool:
        """Whether it shifts a torque that was given, and not what is known of it only."""
        return self._torque is not None

    def acting_on(self, torque: Array, lengths: Sequence[float] = ()) -> ActuatorDelay:
        """Return a delay of a torque (T, n) [N·m]; ``lengths`` [s] are tried too."""
        out = copy.copy(self)
        out._torque, out._further = torque, (*self._further, *lengths)
        return out

    def shifted(self, data: Data, torque: Array, shape: Shape) -> Array:
        """Return `shifted`."""
        return shifted(data, torque, shape)

    def nearby(self, shape: Shape) -> list[Shape]:
        """Return T' about that of a shape."""
        lengths = (factor * shape[0] for factor in STEPS)
        return [(x, *shape[1:]) for x in lengths if abs(x) < LONGEST]

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return `shifted` of the torque, for a T' near T."""
        if self._torque is not None:
            torque = self._torque[:, joint]
        elif data.carried is not None:
            torque = data.nominal[:, joint] + data.carried[:, joint]
        else:
            torque = data.nominal[:, joint]
        return shifted(data, torque, shape)[:, None]

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return T' [s], both ways."""
        found = [-x for x in self._further if x < 0 and x not in TRIED]
        return [
            *((x,) for x in (*TRIED, *self._further)),
            *((-x, part) for part in LOWPASS_PARTS for x in (*SMOOTHED, *found)),
        ]

    def negligible(self, coefficients: Array, shape: Shape) -> bool:
        """Return whether the delay is below `least`."""
        return abs(float(coefficients[0])) < LEAST

    def at_edge(self, shape: Shape, shapes: list[Shape], edge: float) -> bool:
        """Never: the coefficient holds the delay, T' only straightens its curve."""
        return False

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return |T| [s]."""
        return {"delay_s": abs(float(coefficients[0]))}

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Say by how much to shift torques: MuJoCo's actuators are not late."""
        what = "send torques" if part.coefficients[0] >= 0 else "take measured torques as of"
        behind = ", which come behind a low-pass" if len(part.shape) > 1 else ""
        delay = self.parameters_of(part)["delay_s"]
        draft.leave_out(part, f"{what} {delay:.4g} s earlier{behind}")

    def describe(self, coefficients: Array) -> str:
        """Return whether torque acts after it was logged, or was logged after it acted."""
        if coefficients[0] >= 0:
            return self.what
        return "torque is late in the log (measured late, or behind a filter)"

    def why_not_identifiable(self, data: Data, joint: int) -> str:
        """Return whether the arm's torques change too little."""
        least = data.settings.noise.clear * data.noise
        return "" if np.any(data.rigid.std(axis=0) > least) else "no torque changes"
