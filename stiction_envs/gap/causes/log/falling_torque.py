"""Torque of a drive that falls with speed: τ = −s q̇, the drive's own feed-forward of friction.

A drive that compensates friction by itself logs less torque the faster a joint moves. Friction
cannot do so: it would drive the joint.
"""

from typing import ClassVar

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, View, variable
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.signals.dataset import Data


class FallingTorque(Cause):
    """A logged torque against the slope of friction."""

    name: ClassVar[str] = "falling_torque"
    what: ClassVar[str] = "a drive's torque that falls with speed (its own feed-forward)"
    what_to_record: ClassVar[str] = "constant speeds in both directions, and the motors' currents"
    parameters: ClassVar = (Parameter("slope_nms", "N·m·s/rad", 0.0),)
    view: ClassVar = View("joint speed [rad/s]", variable("dq"), note="a slope that falls")

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return minus the speed."""
        return -data.dq[:, joint, None]

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Say what to add: it is the log that lacks it, not the arm."""
        draft.leave_out(part, f"add {part.coefficients[0]:.4g} N·m·s/rad × speed to the torque")
