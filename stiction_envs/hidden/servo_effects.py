"""Causes that are hidden in servo logs: one entry per cause, by the name of the diagnosis.

An entry turns a size into values of a joint's parameters (`gap.servo.servo_parameters`). Simulated
logs (`servo_logs`) hide its usual size; a rehearsal hides three. Sizes are chosen so that they mean
the same on small and large joints: angles, times and shares.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from stiction_envs.arrays import Array
from stiction_envs.gap.servo.causes import ServoLag, servo_cause
from stiction_envs.gap.servo.servo_parameters import FAR, INDEX
from stiction_envs.hidden.rehearsal.jobs import Hideable

STRIBECK_VELOCITY = 0.05  # Stribeck velocity of hidden friction [rad/s]; assumed
DEEPEST = 0.1  # least limit of torque or speed over what is reached without it [-]; assumed
CARRIES = 1.05  # least torque limit over the joint's largest gravity [-]: it does not fall; assumed
MOST_LOAD = 0.4  # largest friction over load [-]: gears that carry back; assumed


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoJoint:
    """A joint of the log before something is hidden in it."""

    parameters: Array
    """(P,), in the order of `servo_parameters.NAMES`."""
    friction: float
    """Dry friction that is there where a cause refines it [N·m]."""
    gravity: float
    """Largest [N·m]."""
    torque: float
    """Largest of its servo along the log [N·m]."""
    speed: float
    """Largest along the log [rad/s]."""
    inertia: float
    """Usual [kg·m²]."""

    def __getitem__(self, name: str) -> float:
        """Return a parameter by its name."""
        return float(self.parameters[INDEX[name]])

    def on_friction(self) -> "ServoJoint":
        """Return the joint with at least its dry friction."""
        p = self.parameters.copy()
        p[INDEX["stiction"]] = max(p[INDEX["stiction"]], self.friction)
        return replace(self, parameters=p)


Law = Callable[[ServoJoint, float], dict[str, float]]
"""Parameters by name that a cause of a size changes."""


@dataclass(frozen=True, kw_only=True)
class ServoEffect(Hideable):
    """A rule that hides a cause in the joints of a servo log."""

    law: Law
    largest: float
    """Largest size to try: more is obvious; assumed."""
    usual: Callable[[ServoJoint], float] | None = None
    """Size that robots have, which simulated logs hide; assumed. None: they do not hide it."""
    shown_as: Callable[[ServoJoint, float], float] | None = None
    """The parameter of a size, as the diagnosis has it; None: the law's first."""
    under_gravity: bool = False
    """Whether only joints under gravity show it."""
    dry: float = 0.015
    """Dry friction over the servo's stiffness that it refines in simulated logs [rad]; assumed."""

    def before(self, joint: ServoJoint) -> ServoJoint:
        """Return the joint without the cause: one that it refines has dry friction."""
        return joint.on_friction() if "coulomb_friction" in self.expected else joint

    def changed(self, joint: ServoJoint, size: float) -> Array:
        """Return (P,) parameters of a joint with the cause."""
        out = self.before(joint).parameters.copy()
        for name, value in self.law(self.before(joint), size).items():
            out[INDEX[name]] = value
        return out

    def shown(self, joint: ServoJoint, size: float) -> float:
        """Return the parameter of a size."""
        if self.shown_as is not None:
            return self.shown_as(joint, size)
        return next(iter(self.law(self.before(joint), size).values()))


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


def _effect(name: str, what_to_record: str, **rest: Any) -> ServoEffect:
    """Return an effect whose size is called, with its unit, as its cause's first parameter."""
    first = servo_cause(name).parameters[0]
    return ServoEffect(name, first.name, first.unit, what_to_record, **rest)


_FREQUENCIES = "commands of several frequencies, up to where the joint hardly follows"
_SLOW = "slow motion through several poses, both ways, with rests"
_VERY_SLOW = "very slow motion, both ways, with rests"
_RESTS = "rests in poses of small and large gravity, reached from both sides"
_LARGE, _SMALL = "large steps of the command", "small steps of the command, with rests"
_FAST = "fast and large waves"
_ALL_JOINTS = "slow motion of all joints through poses of large gravity"
_BOTH_SIDES = "poses on both sides of where gravity's torque on the joint is zero"
_REVERSALS = "many slow reversals of a few mrad to some tens of mrad"
_LAG, _DRY = (ServoLag.name,), ("coulomb_friction",)
_EFFECTS = (
    _effect(
        *("servo_stiffness", _RESTS),
        law=lambda joint, size: {"stiffness": joint["stiffness"] / (1.0 + size)},
        largest=4.0,
        usual=lambda joint: 2 / 3,
        under_gravity=True,
    ),
    _effect(
        *("damping", _FREQUENCIES),
        part_of=_LAG,
        law=lambda joint, size: {"damping": joint["damping"] + size * joint["stiffness"]},
        largest=0.5,
        usual=lambda joint: 1.5 * joint["damping"] / joint["stiffness"],
    ),
    _effect(
        *("delay", _FREQUENCIES),
        part_of=_LAG,
        law=lambda joint, size: {"delay": joint["delay"] + size},
        largest=0.15,
        usual=lambda joint: 0.03,
    ),
    _effect(
        *("armature", _FREQUENCIES),
        part_of=_LAG,
        law=lambda joint, size: {"armature": joint["armature"] + size * joint["stiffness"]},
        largest=0.02,
        usual=lambda joint: 3.0 * joint.inertia / joint["stiffness"],
    ),
    _effect(
        *("coulomb_friction", _SLOW),
        law=lambda joint, size: {"stiction": joint["stiction"] + size * joint["stiffness"]},
        shown_as=_sliding,
        largest=0.3,
        usual=lambda joint: 0.02,
    ),
    _effect(
        *("stribeck_friction", _VERY_SLOW),
        expected=_DRY,
        law=_stribeck,
        shown_as=_extra_stiction,
        largest=3.0,
        usual=lambda joint: 1.0,
    ),
    _effect(
        *("load_dependent_friction", _SLOW),
        expected=_DRY,
        law=lambda joint, size: {"load": joint["load"] + size},
        shown_as=lambda joint, size: size,
        largest=MOST_LOAD,
        usual=lambda joint: MOST_LOAD,
        under_gravity=True,
        dry=0.006,
    ),
    _effect(
        *("torque_limit", _LARGE),
        law=lambda joint, size: {
            "torque_limit": max(_limit(joint.torque, size), CARRIES * joint.gravity)
        },
        largest=1.0,
        usual=lambda joint: DEEPEST / 1.02,
    ),
    _effect(
        *("speed_limit", _FAST),
        law=lambda joint, size: {"speed_limit": _limit(joint.speed, size)},
        largest=1.0,
        usual=lambda joint: DEEPEST / 0.6,
    ),
    _effect(
        *("encoder_offset", _BOTH_SIDES),
        law=lambda joint, size: {"offset": size},
        largest=0.25,
        usual=lambda joint: 0.15,
        under_gravity=True,
    ),
    _effect(
        *("dead_zone", _SMALL),
        law=lambda joint, size: {"dead_zone": joint["dead_zone"] + size},
        shown_as=lambda joint, size: 2.0 * size,
        largest=0.05,
        usual=lambda joint: 0.02,
    ),
    _effect(
        *("payload", _ALL_JOINTS),
        arm_wide=True,
        law=lambda joint, size: {},  # the arm is another
        largest=20.0,
    ),
    _effect(
        *("presliding_hysteresis", _REVERSALS),
        expected=_DRY,
        law=lambda joint, size: {"bristle": joint["bristle"] + size},
        shown_as=lambda joint, size: joint.friction / (joint["bristle"] + size),
        largest=0.05,
        usual=lambda joint: 0.015,
    ),
    _effect(
        *("gravity_compensation_missing", _SLOW),
        law=lambda joint, size: {"compensation": size},
        largest=1.0,
        usual=lambda joint: 0.5,
        under_gravity=True,
    ),
)
EFFECTS = {effect.name: effect for effect in _EFFECTS}
