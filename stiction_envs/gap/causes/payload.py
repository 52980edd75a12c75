"""An unmodelled body on the flange: ten inertial parameters of the last link, linear in torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pinocchio as pin

from stiction_envs.gap.causes.base import Array, Cause, Parameter, Shape, constants
from stiction_envs.gap.causes.draft import PAYLOAD_RADIUS, Body, ModelDraft
from stiction_envs.gap.causes.motion import changes
from stiction_envs.gap.causes.part import Part
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import Recording
from stiction_envs.method_settings import check_numbers


@dataclass(frozen=True, kw_only=True)
class PayloadSettings:
    """When a payload can be seen, and when it is one."""

    heavy: float
    """A payload whose weight must be seen to change [kg]."""
    least_mass: float
    """Of a body that is put into a model [kg]."""
    small: float
    """Mass under which a centre of mass means nothing [kg]."""

    def __post_init__(self) -> None:
        check_numbers(self)


class Payload(Cause):
    """A tool, a gripper, a cable's weight."""

    name: ClassVar[str] = "payload"
    settings: PayloadSettings = constants(PayloadSettings, name)
    what: ClassVar[str] = "unmodelled mass on the flange"
    what_to_record: ClassVar[str] = "static poses with the flange turned all ways"
    arm_wide: ClassVar[bool] = True
    shown_at_rest: ClassVar[bool] = True
    transmitted_by_gear: ClassVar[bool] = True
    parameters: ClassVar = (
        Parameter("mass_kg", "kg", 0.0),
        Parameter("com_m", "m", size=3),
        Parameter("inertia", "kg·m²", size=6),
    )

    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return the torque per m, m c (3) and inertia (6) about the flange, in its axes."""
        return data.recording.derived(_regressor)[:, joint]

    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return mass [kg] and centre of mass in the flange's axes [m]."""
        mass = float(coefficients[0])
        com = coefficients[1:4] / mass if mass > self.settings.small else np.zeros(3)
        return {"mass_kg": mass, "com_m": [float(x) for x in com]}

    def on_bound(self, coefficients: Array, data: Data, joint: int) -> bool:
        """Return whether there is no mass."""
        return bool(coefficients[0] <= 0)

    def negligible(self, coefficients: Array, shape: Shape) -> bool:
        """Return whether its mass is none."""
        return bool(coefficients[0] <= self.settings.small)

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Put a body on the flange; one without mass is none."""
        mass, com = float(part.coefficients[0]), np.array(self.parameters_of(part)["com_m"], float)
        if mass <= self.settings.least_mass:
            draft.leave_out(part, "not a body or a gravity that MuJoCo allows")
            return
        inertia = payload_inertia(part.coefficients, mass, com)
        draft.payloads.append(Body(mass, com, inertia))
        draft.not_in_tables.append(f"{self.name}: in [[cause]] and model.xml")
        if inertia is None:
            draft.not_in_mjcf.append(
                f"{self.name}: the inertia that was found is no body's, so that of a solid sphere "
                f"of {PAYLOAD_RADIUS:g} m stands in (assumed)"
            )

    def why_not_identifiable(self, data: Data, joint: int) -> str:
        """Return whether the arm holds one pose only."""
        if float(np.ptp(data.q, axis=0).max()) < data.settings.motion.travel_span:
            return "the arm holds one pose only"
        weight = data.recording.derived(_regressor)[..., 0]
        if not changes(data, self.settings.heavy * weight).any():
            return "a payload's weight hardly changes any torque along this motion"
        return ""


def payload_inertia(coefficients: tuple[float, ...], mass: float, com: Array) -> Array | None:
    """Return the (3, 3) inertia of a payload about its centre of mass, if a body can have it."""
    if len(coefficients) != 10:
        return None
    xx, xy, yy, xz, yz, zz = coefficients[4:]
    about_flange = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # as pin.Inertia.FromDynamicParameters, whose last bits differ and would be those of model.xml
    own = about_flange - mass * (com @ com * np.eye(3) - np.outer(com, com))
    a, b, c = np.linalg.eigvalsh(own)
    return own if a > 1e-9 and a + b >= c else None


def _regressor(recording: Recording) -> Array:
    """Return (T, n, 10): torque of a body at the flange per inertial parameter in its axes."""
    model = recording.pinocchio
    frame = model.frames[model.getFrameId(recording.arm.end_effector)]
    # a body at the flange seen from the last joint: its ten parameters transform linearly, and a
    # pseudo-inertia needs no mass to do so (pin.Inertia divides by it)
    to_joint = frame.placement.homogeneous
    change = np.empty((10, 10))
    for k, unit in enumerate(np.eye(10)):
        body = pin.PseudoInertia.FromDynamicParameters(unit).toMatrix()
        moved = pin.PseudoInertia.FromMatrix(to_joint @ body @ to_joint.T)
        change[:, k] = moved.toDynamicParameters()
    work = model.createData()
    out = np.empty((len(recording.t), recording.n, 10))
    for i, (q, dq, ddq) in enumerate(zip(recording.q, recording.dq, recording.ddq, strict=True)):
        out[i] = pin.computeJointTorqueRegressor(model, work, q, dq, ddq)[:, -10:] @ change
    return out
