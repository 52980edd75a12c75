"""What a hidden cause does to a joint under a position servo: for a rehearsal of servo logs.

One entry per cause, by the name of the diagnosis. A law turns the parameters of the joint
(`gap.servo.parameters`) and a size into those of the joint with the cause; the plant then simulates
the arm along the commands of the log, so that its servos answer. Sizes are chosen so that they mean
the same on small and large joints: angles, times and shares.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

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
    """Largest size that is tried: more is obvious; assumed."""
    shown_as: Callable[[ServoJoint, float], float] | None = None
    """The parameter of a size, as the diagnosis has it; None: the law's first."""
    on_friction: bool = False
    """Whether it changes a dry friction that must be there, and may be named too."""

    def _values(self, joint: ServoJoint, size: float) -> dict[str, float]:
        return self.law(joint.on_friction() if self.on_friction else joint, size)

    def changed(self, joint: ServoJoint, size: float) -> Array:
        """Return (P,) parameters of a joint with the cause."""
        out = (joint.on_friction() if self.on_friction else joint).parameters.copy()
        for name, value in self._values(joint, size).items():
            out[INDEX[name]] = value
        return out

    def shown(self, joint: ServoJoint, size: float) -> float:
        """Return the parameter of a size."""
        if self.shown_as is not None:
            return self.shown_as(joint, size)
        return next(iter(self._values(joint, size).values()))


def _effect(
    name: str,
    parameter: str,
    unit: str,
    what_to_record: str,
    law: Law,
    *,
    largest: float,
    shown_as: Callable[[ServoJoint, float], float] | None = None,
    on_friction: bool = False,
    arm_wide: bool = False,
) -> ServoEffect:
    """Return an effect, from fields of `ServoEffect` and of `Hideable`."""
    what = Hideable(
        name=name,
        parameter=parameter,
        unit=unit,
        what_to_record=what_to_record,
        expected=("coulomb_friction",) if on_friction else (),
        part_of=(SERVO_LAG,) if name in LAG else (),
        arm_wide=arm_wide,
    )
    return ServoEffect(
        what=what, law=law, largest=largest, shown_as=shown_as, on_friction=on_friction
    )


def effect_of(name: str) -> ServoEffect:
    """Return how to hide a cause.

    Raises:
        StictionError: an unknown one.
    """
    if name not in EFFECTS:
        raise unknown("cause", name, tuple(EFFECTS))
    return EFFECTS[name]


def _limit(reached: float, size: float) -> float:
    """Return a limit that falls with the size, from where it is never reached."""
    return min(DEEPEST * reached / max(size, 1e-12), FAR)


def _stribeck(joint: ServoJoint, size: float) -> dict[str, float]:
    sliding = joint["stiction"] * (1.0 - joint["drop"])
    stiction = joint["stiction"] * (1.0 + size)
    drop = 1.0 - sliding / stiction
    return {"stiction": stiction, "drop": drop, "stribeck_velocity": STRIBECK_VELOCITY}


def _sliding(joint: ServoJoint, size: float) -> float:
    """Return the friction in motion [N·m]."""
    return (joint["stiction"] + size * joint["stiffness"]) * (1.0 - joint["drop"])


def _extra_stiction(joint: ServoJoint, size: float) -> float:
    """Return the friction at rest above its level in motion [N·m]."""
    law = _stribeck(joint.on_friction(), size)
    return law["stiction"] * law["drop"]


def _nothing(joint: ServoJoint, size: float) -> dict[str, float]:
    return {}


_FREQUENCIES = "commands of several frequencies, up to where the joint hardly follows"
_SLOW = "slow motion through several poses, both ways, with rests"
_EFFECTS = (
    _effect(
        *("servo_stiffness", "stiffness_nm_per_rad", "N·m/rad"),
        "rests in poses of small and large gravity, reached from both sides",
        lambda joint, size: {"stiffness": joint["stiffness"] / (1.0 + size)},
        largest=4.0,
    ),
    _effect(
        *("damping", "damping_nms", "N·m·s/rad", _FREQUENCIES),
        lambda joint, size: {"damping": joint["damping"] + size * joint["stiffness"]},
        largest=0.5,
    ),
    _effect(
        *("armature", "armature_kgm2", "kg·m²", _FREQUENCIES),
        lambda joint, size: {"armature": joint["armature"] + size * joint["stiffness"]},
        largest=0.02,
    ),
    _effect(
        *("delay", "delay_s", "s", _FREQUENCIES),
        lambda joint, size: {"delay": joint["delay"] + size},
        largest=0.15,
    ),
    _effect(
        *("torque_limit", "limit_nm", "N·m", "large steps of the command"),
        lambda joint, size: {
            "torque_limit": max(_limit(joint.torque, size), CARRIES * joint.gravity)
        },
        largest=1.0,
    ),
    _effect(
        *("speed_limit", "limit_rad_s", "rad/s", "fast and large waves"),
        lambda joint, size: {"speed_limit": _limit(joint.speed, size)},
        largest=1.0,
    ),
    _effect(
        *("dead_zone", "width_rad", "rad", "small steps of the command, with rests"),
        lambda joint, size: {"dead_zone": joint["dead_zone"] + size},
        shown_as=lambda joint, size: 2.0 * size,
        largest=0.05,
    ),
    _effect(
        *("coulomb_friction", "coulomb_nm", "N·m", _SLOW),
        lambda joint, size: {"stiction": joint["stiction"] + size * joint["stiffness"]},
        shown_as=_sliding,
        largest=0.3,
    ),
    _effect(
        *("stribeck_friction", "stiction_nm", "N·m"),
        "very slow motion, both ways, with rests",
        _stribeck,
        shown_as=_extra_stiction,
        largest=3.0,
        on_friction=True,
    ),
    _effect(
        *("load_dependent_friction", "load_coefficient", "1", _SLOW),
        lambda joint, size: {"load": joint["load"] + size},
        shown_as=lambda joint, size: size,
        largest=MOST_LOAD,
        on_friction=True,
    ),
    _effect(
        *("presliding_hysteresis", "bristle_stiffness", "N·m/rad"),
        "many slow reversals of a few mrad to some tens of mrad",
        lambda joint, size: {"bristle": joint["bristle"] + size},
        shown_as=lambda joint, size: joint.friction / (joint["bristle"] + size),
        largest=0.05,
        on_friction=True,
    ),
    _effect(
        *("encoder_offset", "offset_rad", "rad"),
        "poses on both sides of where gravity's torque on the joint is zero",
        lambda joint, size: {"offset": size},
        largest=0.25,
    ),
    _effect(
        *("gravity_compensation_missing", "share", "1", _SLOW),
        lambda joint, size: {"compensation": size},
        largest=1.0,
    ),
    _effect(
        *("payload", "mass_kg", "kg"),
        "slow motion of all joints through poses of large gravity",
        _nothing,  # the arm is another
        largest=20.0,
        arm_wide=True,
    ),
    _effect(
        *("external_contact", "depth_rad", "rad"),
        "motion whose ends differ, with the current logged",
        _nothing,  # the angle stops at a wall, so far below the top of its motion
        shown_as=lambda joint, size: min(size, joint.above),
        largest=1.0,
    ),
)
EFFECTS = {effect.what.name: effect for effect in _EFFECTS}
"""By name of the cause."""
