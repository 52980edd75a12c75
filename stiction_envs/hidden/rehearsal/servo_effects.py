"""What a hidden cause does to a joint under a position servo: for a rehearsal of servo logs.

One entry per cause, by the name of the diagnosis. A law turns the parameters of the joint
(`gap.servo.parameters`) and a size into those of the joint with the cause; the plant then simulates
the arm along the commands of the log, so that its servos answer. Sizes are chosen so that they mean
the same on small and large joints: angles, times and shares.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import unknown
from stiction_envs.gap.servo.parameters import FAR, INDEX
from stiction_envs.gap.servo.spread import LAG, SERVO_LAG
from stiction_envs.hidden.rehearsal.jobs import Hideable
from stiction_envs.hidden.servo_logs import MOST_LOAD

Array = NDArray[np.float64]
STRIBECK_VELOCITY = 0.05
"""Of hidden Stribeck friction [rad/s]; assumed."""
DEEPEST = 0.1
"""Least limit of torque or speed over what is reached without it [-]; assumed."""
CARRIES = 1.05
"""Least torque limit over the joint's largest gravity [-]: it does not fall; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoJoint:
    """A joint of the log before something is hidden in it."""

    parameters: Array
    """(P,), in the order of `parameters.NAMES`."""
    friction: float
    """Dry friction that is there where a cause refines it [N·m]."""
    gravity: float
    """Largest [N·m]."""
    torque: float
    """Largest of its servo along the log [N·m]."""
    speed: float
    """Largest along the log [rad/s]."""
    above: float
    """Angle between the top of its motion and where it mostly is [rad]."""

    def __getitem__(self, name: str) -> float:
        """Return a parameter by its name."""
        return float(self.parameters[INDEX[name]])

    def on_friction(self) -> ServoJoint:
        """Return the joint with at least its dry friction."""
        p = self.parameters.copy()
        p[INDEX["stiction"]] = max(p[INDEX["stiction"]], self.friction)
        return replace(self, parameters=p)


Law = Callable[[ServoJoint, float], dict[str, float]]
"""Parameters by name that a cause of a size changes."""


@dataclass(frozen=True, kw_only=True)
class ServoEffect:
    """How a cause is hidden in the joints of a servo log."""

    what: Hideable
    law: Law
    largest: float
    """Size beyond which nobody would have to ask; assumed."""
    shown: Callable[[ServoJoint, float], float]
    """The parameter of a size."""
    on_friction: bool = False
    """Whether it changes a dry friction that must be there, and may be named too."""
    arm_wide: bool = False

    def changed(self, joint: ServoJoint, size: float) -> Array:
        """Return (P,) parameters of a joint with the cause."""
        if self.on_friction:
            joint = joint.on_friction()
        out = joint.parameters.copy()
        for name, value in self.law(joint, size).items():
            out[INDEX[name]] = value
        return out


EFFECTS: dict[str, ServoEffect] = {}
"""By name of the cause."""


def effect(
    name: str,
    parameter: str,
    unit: str,
    what_to_record: str,
    *,
    largest: float,
    shown: Callable[[ServoJoint, float], float] = lambda joint, size: size,
    on_friction: bool = False,
    **traits: Any,
) -> Callable[[Law], Law]:
    """Enter a law into `EFFECTS`."""
    what = Hideable(
        name=name,
        parameter=parameter,
        unit=unit,
        what_to_record=what_to_record,
        expected=("coulomb_friction",) if on_friction else (),
        part_of=(SERVO_LAG,) if name in LAG else (),
    )

    def enter(law: Law) -> Law:
        made: dict[str, Any] = {"what": what, "law": law, "largest": largest, "shown": shown}
        EFFECTS[name] = ServoEffect(on_friction=on_friction, **made, **traits)
        return law

    return enter


def effect_of(name: str) -> ServoEffect:
    """Return how to hide a cause.

    Raises:
        StictionError: an unknown one.
    """
    if name not in EFFECTS:
        raise unknown("cause", name, tuple(EFFECTS))
    return EFFECTS[name]


_FREQUENCIES = "commands of several frequencies, up to where the joint hardly follows"
_SLOW = "slow motion through several poses, both ways, with rests"


# ---- the servo -----------------------------------------------------------------------------------


@effect(
    *("servo_stiffness", "stiffness_nm_per_rad", "N·m/rad"),
    "rests in poses of small and large gravity, reached from both sides",
    largest=4.0,
    shown=lambda joint, size: joint["stiffness"] / (1.0 + size),
)
def _softer(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"stiffness": joint["stiffness"] / (1.0 + size)}


def _damping(joint: ServoJoint, size: float) -> float:
    return joint["damping"] + size * joint["stiffness"]


@effect("damping", "damping_nms", "N·m·s/rad", _FREQUENCIES, largest=0.5, shown=_damping)
def _damped(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"damping": _damping(joint, size)}


def _armature(joint: ServoJoint, size: float) -> float:
    return joint["armature"] + size * joint["stiffness"]


@effect("armature", "armature_kgm2", "kg·m²", _FREQUENCIES, largest=0.02, shown=_armature)
def _heavier(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"armature": _armature(joint, size)}


@effect(
    *("delay", "delay_s", "s", _FREQUENCIES),
    largest=0.15,
    shown=lambda joint, size: joint["delay"] + size,
)
def _late(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"delay": joint["delay"] + size}


def _limit(reached: float, size: float) -> float:
    """Return a limit that falls with the size, from where it is never reached."""
    return min(DEEPEST * reached / max(size, 1e-12), FAR)


def _torque_limit(joint: ServoJoint, size: float) -> float:
    return max(_limit(joint.torque, size), CARRIES * joint.gravity)


@effect(
    *("torque_limit", "limit_nm", "N·m", "large steps of the command"),
    largest=1.0,
    shown=_torque_limit,
)
def _weak(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"torque_limit": _torque_limit(joint, size)}


def _speed_limit(joint: ServoJoint, size: float) -> float:
    return _limit(joint.speed, size)


@effect(
    *("speed_limit", "limit_rad_s", "rad/s", "fast and large waves"),
    largest=1.0,
    shown=_speed_limit,
)
def _slow(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"speed_limit": _speed_limit(joint, size)}


@effect(
    *("dead_zone", "width_rad", "rad", "small steps of the command, with rests"),
    largest=0.05,
    shown=lambda joint, size: 2.0 * size,
)
def _idle(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"dead_zone": joint["dead_zone"] + size}


# ---- friction ------------------------------------------------------------------------------------


def _level(joint: ServoJoint, size: float) -> float:
    return joint["stiction"] + size * joint["stiffness"]


@effect("coulomb_friction", "coulomb_nm", "N·m", _SLOW, largest=0.3, shown=_level)
def _dry(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"stiction": _level(joint, size)}


@effect(
    *("stribeck_friction", "stiction_nm", "N·m", "very slow motion, both ways, with rests"),
    largest=3.0,
    shown=lambda joint, size: joint.friction * (1.0 + size),
    on_friction=True,
)
def _stribeck(joint: ServoJoint, size: float) -> dict[str, float]:
    sliding = joint["stiction"] * (1.0 - joint["drop"])
    stiction = joint["stiction"] * (1.0 + size)
    return {
        "stiction": stiction,
        "drop": 1.0 - sliding / stiction,
        "stribeck_velocity": STRIBECK_VELOCITY,
    }


@effect(
    *("load_dependent_friction", "load_coefficient", "1", _SLOW),
    largest=MOST_LOAD,
    on_friction=True,
)
def _loaded(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"load": joint["load"] + size}


@effect(
    *("presliding_hysteresis", "bristle_stiffness", "N·m/rad"),
    "many slow reversals of a few mrad to some tens of mrad",
    largest=0.05,
    shown=lambda joint, size: joint.friction / (joint["bristle"] + size),
    on_friction=True,
)
def _gives(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"bristle": joint["bristle"] + size}


# ---- gravity, the log, and what is outside -------------------------------------------------------


@effect(
    *("encoder_offset", "offset_rad", "rad"),
    "poses on both sides of where gravity's torque on the joint is zero",
    largest=0.25,
)
def _shifted(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"offset": size}


@effect("gravity_compensation_missing", "share", "1", _SLOW, largest=1.0)
def _lifted(joint: ServoJoint, size: float) -> dict[str, float]:
    return {"compensation": size}


@effect(
    *("payload", "mass_kg", "kg", "slow motion of all joints through poses of large gravity"),
    largest=20.0,
    arm_wide=True,
)
def _tool(joint: ServoJoint, size: float) -> dict[str, float]:
    return {}  # the arm is another


@effect(
    *("external_contact", "depth_rad", "rad", "motion whose ends differ, with the current logged"),
    largest=1.0,
    shown=lambda joint, size: min(size, joint.above),
)
def _wall(joint: ServoJoint, size: float) -> dict[str, float]:
    return {}  # the angle stops at a wall, so far below the top of its motion
