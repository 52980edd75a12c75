"""Friction of one joint over speed, Figure 2.3: the law of the shipped friction, and simulated.

    curve = friction_curve("panda")
    curve.law(0.01)

A joint whose axis is vertical bears no weight: what its motor gives at a constant speed is
friction. The simulated points are measured so, on the arm in MuJoCo, without position ripple.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.friction.model import link_inertia
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.thesis.settings import thesis_settings

Array = NDArray[np.float64]
JOINT = 1
"""The first joint of both arms turns about the vertical."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionCurve:
    """Friction of one joint at constant speeds; levels by direction, + first."""

    robot: str
    joint: int
    """From 1."""
    stiction: Array
    """(2,) [N·m]."""
    coulomb: Array
    """(2,) [N·m]."""
    stribeck: Array
    """(2,) [rad/s]."""
    viscous: Array
    """(2,) [N·m·s/rad]."""
    speed: Array
    """(S,) simulated, ascending [rad/s]."""
    torque: Array
    """(S,) of the motor, signed as the speed [N·m]."""

    def law(self, speed: ArrayLike) -> Array:
        """Return the friction of the law at speeds [N·m], signed as they are."""
        v = np.asarray(speed, dtype=np.float64)
        k = (v < 0).astype(np.int64)
        peak = np.exp(-np.square(v / self.stribeck[k]))
        level = self.coulomb[k] + (self.stiction[k] - self.coulomb[k]) * peak
        return np.asarray(np.sign(v) * level + self.viscous[k] * v)


def friction_curve(robot: str, *, nthread: int = 0) -> FrictionCurve:
    """Return law and simulated friction of an arm's first joint.

    Args:
        robot: the arm.
        nthread: threads, 0 for all processors.
    """
    s = thesis_settings().curve
    sticking = sticking_model(robot)
    arm, j = sticking.arm, JOINT - 1
    none = np.zeros(arm.n)
    p = sticking.parameters.replace(offset=none, gravity_error=none, ripple_amplitude=none)
    one = np.geomspace(s.slowest, s.fastest, s.speeds)
    speed = np.concatenate([-one[::-1], one])
    plant = Plant(sticking, len(speed), parameters=p, nthread=nthread)
    ids = np.arange(len(speed))
    # heavy joints and light ones alike: a servo of one frequency, critically damped
    inertia = link_inertia(arm, arm.rest[None])[0] + p.rotor_inertia
    omega = 2 * np.pi * s.servo_frequency
    stiffness, damping = omega**2 * inertia, 2 * omega * inertia
    plant.set_servo(ids, stiffness, damping, arm.rest)
    duration = np.maximum(s.travel / np.abs(speed), s.least_time)
    steps = np.rint(duration / CONTROL_DT).astype(int)
    longest = int(steps.max())
    setpoint = np.broadcast_to(arm.rest, (len(speed), longest, arm.n)).copy()
    time = (np.arange(longest) + 1) * CONTROL_DT
    setpoint[:, :, j] += speed[:, None] * np.minimum(time, steps[:, None] * CONTROL_DT)
    angle = plant.run(np.zeros((len(speed), longest, arm.n)), setpoint=setpoint)[:, :, j]
    torque = np.empty(len(speed))
    for k, end in enumerate(steps):
        now = np.arange(int(end - s.averaged * end), int(end))
        # the servo acts on the angle at the start of the step
        lag = float(np.mean(setpoint[k, now, j] - angle[k, now - 1]))
        torque[k] = stiffness[j] * lag - damping[j] * speed[k]
    level = p.stiction_at(plant.load[1][0])[j]
    return FrictionCurve(
        robot=robot,
        joint=JOINT,
        stiction=level,
        coulomb=level * p.coulomb_ratio[j],
        stribeck=p.stribeck_velocity[j],
        viscous=p.viscous[j],
        speed=speed,
        torque=torque,
    )
