"""A joint whose zero is off: it reads q = q_true + δ, so that the arm stands at q − δ.

Torques of this joint and of all others are those at another angle, to first order −δ ∂τ/∂q_j of
the inverse dynamics τ(q, q̇, q̈). Once an offset is found, the column is its exact torque,
(τ(q − δ_0) − τ(q))/δ_0 at δ_0 = δ (`resized`). In a model the link is turned by −δ about its joint,
which is exact.
"""

import dataclasses
import xml.etree.ElementTree as ET
from typing import ClassVar

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from stiction_envs.gap.causes.base import (
    ALL_OF_ONE,
    ZERO,
    Array,
    Cause,
    Columns,
    Parameter,
    Prior,
    Shape,
    View,
)
from stiction_envs.gap.causes.draft import ModelDraft, Part
from stiction_envs.gap.servo.servo_parameters import BOTH_SIDES, InServo
from stiction_envs.gap.signals.angles import AngleError
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.recording import Recording
from stiction_envs.gap.signals.rigid_body import inverse_dynamics, under
from stiction_envs.robots import Arm, mjcf

USUAL = 0.1
"""Prior standard deviation of an offset, which must change torques visibly [rad]; assumed: a joint
put back by eye after a repair."""
MOST = 0.5
"""Largest offset that a tangent finds [rad]; assumed. Larger ones are found before
(`signals.angles`)."""
LEAST = 5e-4
"""Offset that does not count [rad]; assumed: the error of a careful calibration."""


class EncoderOffset(Cause):
    """A zero that a repair, a slipped clamp or a coarse calibration left off."""

    name: ClassVar[str] = "encoder_offset"
    what: ClassVar[str] = "a joint's zero is off"
    what_to_record: ClassVar[str] = (
        "static poses with the joint and those before it over their whole range"
    )
    shown_at_rest: ClassVar[bool] = True
    acts_on: ClassVar[str] = ALL_OF_ONE
    adds_to: ClassVar[str] = ZERO
    least: ClassVar[float] = LEAST
    parameters: ClassVar = (Parameter("offset_rad", "rad", -2 * np.pi, 2 * np.pi),)
    view: ClassVar = View(
        "−∂τ/∂q of the joint [N·m/rad]",
        lambda data, joint, shape: data.links.derived(_slopes)[:, joint, joint],
        note="a slope: the offset",
    )
    servo: ClassVar = InServo(
        sizes={"offset": 0.15},
        starts=lambda x: [{"offset": 0.1}, {"offset": -0.1}],
        stage=2,
        of_gravity=True,
        of_known_servo=True,
        evidence="gravity sags the joint as if it stood at another angle",
        alike=("torque_offset", "payload"),
        tells_apart=BOTH_SIDES,
    )

    def __init__(self, far: AngleError | None = None) -> None:
        """Take the joint whose zero is far off, found by `angles`; None for none."""
        self.far = far

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return δ_0 [rad] to try: the tangent at 0, and its fit.

        A link's centre that is free in three directions fits the curvature better than a tangent.
        """
        if self.far is not None and self.far.offset and joint == self.far.joint - 1:
            return [(self.far.offset,)]
        slope = data.links.derived(_slopes, *data.gravity_found)[:, :, joint]
        rows = data.block >= 0
        torque = (data.residual[rows] - data.residual[rows].mean(axis=0)) / data.noise
        slope = (slope[rows] - slope[rows].mean(axis=0)) / data.noise
        found = float((slope * torque).sum()) / max(float(np.square(slope).sum()), 1e-300)
        return [(0.0,), (found,)] if LEAST < abs(found) < MOST else [(0.0,)]

    def prior(self, data: Data, joint: int, shape: Shape) -> Prior:
        """Return `USUAL`; a zero that is far off is another one, of a whole turn."""
        far = self.far is not None and joint == self.far.joint - 1
        return Prior(np.array([np.pi if far else USUAL]))

    def columns(self, data: Data, joint: int, shape: Shape) -> Columns:
        """Return the torque per radian on all joints."""
        if not shape[0]:
            return data.links.derived(_slopes, *data.gravity_found)[:, :, joint, None]
        recording, there = data.links, data.q.copy()
        there[:, joint] -= shape[0]
        model = under(recording.pinocchio, data.gravity_found)
        more = inverse_dynamics(model, there, data.dq, data.ddq)
        more -= recording.derived(_torques, *data.gravity_found)
        return np.asarray(more[..., None] / shape[0])

    def resized(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return the offset that was found."""
        found = float(coefficients[0])
        return (found,) if abs(found) > LEAST else shape

    def changed(self, arm: Arm, part: Part) -> Arm:
        """Return the arm whose joint reads δ more: at zero its link is turned by −δ."""
        root, model = ET.fromstring(arm.xml), arm.model()
        joint = model.joint(arm.joint_names[part.joint - 1])
        body = model.body(int(joint.bodyid[0]))
        frame = Rotation.from_quat(body.quat, scalar_first=True)
        back = Rotation.from_rotvec(-part.coefficients[0] * joint.axis)
        pos = body.pos + frame.apply(joint.pos - back.apply(joint.pos))
        element = next(e for e in root.iter("body") if e.get("name") == body.name)
        for key in ("euler", "axisangle", "xyaxes", "zaxis"):
            element.attrib.pop(key, None)
        element.set("pos", mjcf.numbers(pos))
        element.set("quat", mjcf.numbers((frame * back).as_quat(scalar_first=True)))
        return dataclasses.replace(arm, xml=ET.tostring(root, encoding="unicode"))

    def contribute(self, draft: ModelDraft, part: Part) -> None:
        """Say where it is: in the pose of the link, so that angles are those of the logs."""
        draft.not_in_tables.append(
            f"{self.name} of joint {part.joint}: in [[cause]], and in model.xml as a turned link"
        )


def _torques(recording: Recording, *gravity: float) -> Array:
    """Return (T, n) torque of the arm along a recording [N·m], ``gravity`` as of `under`."""
    if not gravity:
        return recording.rigid
    model = under(recording.pinocchio, gravity)
    return inverse_dynamics(model, recording.q, recording.dq, recording.ddq)


def _slopes(recording: Recording, *gravity: float) -> Columns:
    """Return (T, n, n) −∂τ/∂q of the inverse dynamics, torque first [N·m/rad].

    Derivatives of Newton and Euler's recursion (J. Carpentier, N. Mansard, "Analytical derivatives
    of rigid body dynamics algorithms", RSS 2018). ``gravity`` as of `under`.
    """
    model = under(recording.pinocchio, gravity)
    work = model.createData()
    out = np.empty((*recording.q.shape, recording.n), dtype=np.float32)
    for k, row in enumerate(zip(recording.q, recording.dq, recording.ddq, strict=True)):
        out[k] = pin.computeRNEADerivatives(model, work, *row)[0]
    return -out
