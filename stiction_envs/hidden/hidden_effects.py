"""What can be hidden in a simulated log: one entry per effect, by the name of the diagnosis.

An entry changes the `World` before it is simulated and returns the truth. It declares the joints on
which it can be seen and the motions that excite it. It shares only the name and the keys of the
parameters with the cause of the diagnosis. A payload that only the model has is an effect with its
own name, ``phantom_payload``; as a cause it is a payload of negative mass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from stiction_envs.hidden.hidden_motions import CENTRE, REACH
from stiction_envs.robots import Arm, load_arm

Array = NDArray[np.float64]
Values = dict[str, float | list[float]]
FRICTION = np.array([0.7, 0.9, 0.7, 0.8, 0.5, 0.4, 0.5])
"""(7,) usual dry friction [N·m]; assumed."""
ROTOR = np.array([0.3, 0.4, 0.3, 0.3, 0.12, 0.12, 0.1])
"""(7,) usual rotor inertia [kg·m²]; assumed."""
PANDA_LINK_KG = np.array([4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522])
"""(7,) of the arm that is simulated [kg]. Source: ``robots/panda.xml``."""
HALF_HEIGHT = 2 * np.sqrt(2 * np.log(2))
"""Width of a Gaussian at half its height, in standard deviations."""
PRESLIDING_DISTANCE = 1e-4
"""Presliding distance of joints without visible presliding [rad]; assumed."""


def _zeros() -> Array:
    return np.zeros(7)


@dataclass
class World:
    """Everything that a cause may change before the simulation starts; (7,) per joint."""

    rigid: Arm = field(default_factory=lambda: load_arm("panda"))
    """Links as they are, before hidden causes."""
    coulomb: Array = field(default_factory=_zeros)
    """Known to the robot's makers [N·m]."""
    viscous: Array = field(default_factory=_zeros)
    """Known to the robot's makers [N·m·s/rad]."""
    rotor: Array = field(default_factory=_zeros)
    """Known to the robot's makers [kg·m²]."""
    more_coulomb: Array = field(default_factory=_zeros)
    more_viscous: Array = field(default_factory=_zeros)
    stribeck: Array = field(default_factory=_zeros)
    stribeck_velocity: Array = field(default_factory=lambda: np.full(7, 0.05))
    asymmetry: Array = field(default_factory=_zeros)
    load: Array = field(default_factory=_zeros)
    distance: Array = field(default_factory=lambda: np.full(7, PRESLIDING_DISTANCE))
    drift: Array = field(default_factory=_zeros)
    ripple: Array = field(default_factory=_zeros)
    periods: Array = field(default_factory=lambda: np.ones(7))
    phase: Array = field(default_factory=_zeros)
    offset: Array = field(default_factory=_zeros)
    scale: Array = field(default_factory=lambda: np.ones(7))
    armature: Array = field(default_factory=_zeros)
    spring: Array = field(default_factory=_zeros)
    spring_rest: Array = field(default_factory=_zeros)
    harmonics: Array = field(default_factory=lambda: np.zeros((7, 2, 2)))
    """Cosine and sine of the first two harmonics of each joint's angle [N·m]."""
    hump: Array = field(default_factory=lambda: np.tile([0.0, 0.0, 1.0], (7, 1)))
    """Height [N·m], middle [rad] and standard deviation [rad] of a Gaussian over the angle."""
    payload: tuple[float, Array] | None = None
    """Mass [kg] and centre of mass [m]."""
    phantom: tuple[float, Array] | None = None
    """The same of a payload that the robot's makers know and the robot lacks."""
    links: dict[int, tuple[float, Array]] = field(default_factory=dict)
    """By link (from 1): mass [kg] and centre of mass [m] beyond what the makers know."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """Lean and azimuth [rad]."""
    soft: tuple[int, float] | None = None
    """Joint (from 0) and stiffness [N·m/rad]."""
    gap: tuple[int, float] | None = None
    """Joint (from 0) and gap [rad]."""
    delay: float = 0.0
    """[s]."""
    zero: Array = field(default_factory=_zeros)
    """Reading of each joint less its angle [rad]."""
    gravity_missing: float = 0.0
    """Share of the makers' gravity torque that the logged torques lack [-]."""

    def smooth_torque(self, q: Array) -> Array:
        """Return (..., 7) torque over the angle at angles (..., 7) [N·m]."""
        k = np.arange(1, 3)[:, None] * q[..., None, :]
        waves = self.harmonics[..., 0].T * np.cos(k) + self.harmonics[..., 1].T * np.sin(k)
        height, middle, width = self.hump.T
        hump = height * np.exp(-0.5 * np.square((q - middle) / width))
        return np.asarray(waves.sum(axis=-2) + hump)


@dataclass(frozen=True, kw_only=True)
class Draw:
    """Random numbers of one hidden cause."""

    joint: int
    """From 0."""
    sign: float
    size: float
    """0 (just visible) to 1 (large)."""
    seconds: float
    """Length of the log [s]."""
    rng: np.random.Generator
    """For what else an effect draws."""

    def between(self, low: float, high: float) -> float:
        """Return the value of this size, even in the logarithm."""
        return float(low * (high / low) ** self.size)

    @property
    def friction(self) -> float:
        """Usual dry friction of the joint [N·m]."""
        return float(FRICTION[self.joint])


@dataclass(frozen=True, kw_only=True)
class Effect:
    """How a cause is hidden."""

    hide: Callable[[World, Draw], Values]
    """Changes the world; returns the truth under the keys of ``diagnosis.json``."""
    motions: tuple[str, ...]
    """Of `MOTIONS`, those that excite it."""
    joints: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 7)
    """From 1, those on which it can be seen at all."""
    needs_friction: bool = False
    """Whether it acts on friction or rotors that are there already."""
    arm_wide: bool = False
    cause: str
    """Its name in the diagnosis."""
    excludes: frozenset[str] = frozenset()
    """Effects that are not hidden with it, as no log separates them."""


EFFECTS: dict[str, Effect] = {}
"""By name, in the order of the contract; an effect of another name follows its cause."""


class Traits(TypedDict, total=False):
    """Fields of `Effect`."""

    joints: tuple[int, ...]
    needs_friction: bool
    arm_wide: bool
    excludes: frozenset[str]


def effect(
    name: str, *motions: str, cause: str = "", **traits: Unpack[Traits]
) -> Callable[[Callable[[World, Draw], Values]], Callable[[World, Draw], Values]]:
    """Enter a function that hides a cause into `EFFECTS`; its traits are fields of `Effect`."""

    def enter(hide: Callable[[World, Draw], Values]) -> Callable[[World, Draw], Values]:
        EFFECTS[name] = Effect(hide=hide, motions=motions, cause=cause or name, **traits)
        return hide

    return enter


@effect("coulomb_friction", "fourier", "reversals", "sweeps")
def _coulomb(w: World, d: Draw) -> Values:
    j, sign = d.joint, d.sign if w.coulomb[d.joint] else 1.0
    w.more_coulomb[j] = sign * d.between(0.3, 0.8) * (w.coulomb[j] or d.friction)
    return {"coulomb_nm": w.more_coulomb[j]}


@effect("viscous_friction", "fourier", "fast", "sweeps")
def _viscous(w: World, d: Draw) -> Values:
    j, sign = d.joint, d.sign if w.viscous[d.joint] else 1.0
    w.more_viscous[j] = sign * d.between(0.4, 0.9) * (w.viscous[j] or 2 * d.friction)
    return {"viscous_nms": w.more_viscous[j]}


@effect("stribeck_friction", "sweeps", "rests", needs_friction=True)
def _stribeck(w: World, d: Draw) -> Values:
    j = d.joint
    w.stribeck[j] = d.between(0.3, 1.2) * d.friction
    w.stribeck_velocity[j] = np.exp(d.rng.uniform(np.log(0.03), np.log(0.12)))
    return {"stiction_nm": w.stribeck[j], "stribeck_velocity": w.stribeck_velocity[j]}


@effect("direction_asymmetry", "rests", needs_friction=True)
def _asymmetry(w: World, d: Draw) -> Values:
    w.asymmetry[d.joint] = d.sign * d.between(0.2, 0.5) * w.coulomb[d.joint]
    return {"asymmetry_nm": w.asymmetry[d.joint]}


@effect("load_dependent_friction", "fourier", "fast", joints=(2, 4), needs_friction=True)
def _load(w: World, d: Draw) -> Values:
    w.load[d.joint] = d.between(0.02, 0.1)
    return {"load_coefficient": w.load[d.joint]}


@effect("presliding_hysteresis", "reversals", needs_friction=True)
def _presliding(w: World, d: Draw) -> Values:
    w.distance[d.joint] = d.between(3e-3, 2e-2)
    return {"bristle_stiffness": w.coulomb[d.joint] / w.distance[d.joint]}


@effect("position_dependent_friction", "sweeps", "fourier")
def _ripple(w: World, d: Draw) -> Values:
    j = d.joint
    w.ripple[j] = d.between(0.2, 1.0) * d.friction
    w.periods[j] = float(d.rng.integers(12, 50))
    w.phase[j] = d.rng.uniform(-np.pi, np.pi)
    return {"ripple_nm": w.ripple[j], "periods_per_rev": w.periods[j], "phase_rad": w.phase[j]}


@effect("warm_up_drift", "fourier", "sweeps", "reversals", needs_friction=True)
def _drift(w: World, d: Draw) -> Values:
    w.drift[d.joint] = d.sign * d.between(0.4, 0.8) * w.coulomb[d.joint] / d.seconds
    return {"drift_nm_per_s": w.drift[d.joint]}


OVER_ANGLE = frozenset({"torque_offset", "external_spring", "position_dependent_torque"})
"""On one joint an offset and a spring are a smooth torque over the angle."""
ON_FLANGE = frozenset({"payload", "phantom_payload"})
"""The one takes the other away."""


@effect("torque_offset", "fourier", "poses", "rests", excludes=OVER_ANGLE)
def _offset(w: World, d: Draw) -> Values:
    w.offset[d.joint] = d.sign * d.between(0.2, 1.5) * d.friction
    return {"offset_nm": w.offset[d.joint]}


@effect("torque_scale", "fourier", "poses", joints=(2, 4))
def _scale(w: World, d: Draw) -> Values:
    w.scale[d.joint] = 1 + d.sign * d.between(0.03, 0.2)
    return {"scale": w.scale[d.joint]}


@effect("payload", "fourier", "poses", "fast", arm_wide=True, excludes=ON_FLANGE)
def _payload(w: World, d: Draw) -> Values:
    mass, com = d.between(0.1, 2.0), d.rng.uniform(-0.06, 0.06, 3) + np.array([0, 0, 0.05])
    w.payload = (mass, com)
    return {"mass_kg": mass, "com_m": com.tolist()}


@effect(
    "phantom_payload",
    *("fourier", "poses", "fast"),
    arm_wide=True,
    cause="payload",
    excludes=ON_FLANGE,
)
def _phantom(w: World, d: Draw) -> Values:
    mass, com = d.between(0.35, 0.75), d.rng.uniform(-0.03, 0.03, 3) + np.array([0, 0, 0.05])
    w.phantom = (mass, com)
    return {"mass_kg": -mass, "com_m": com.tolist()}


# link 1 turns about the vertical only, and a body on link 7 is a payload
@effect("link_parameters", "fourier", "poses", "fast", joints=(2, 3, 4, 5, 6), arm_wide=True)
def _link(w: World, d: Draw) -> Values:
    mass = d.sign * d.between(0.05, 0.3) * PANDA_LINK_KG[d.joint]
    towards = d.rng.normal(size=3)
    com = d.rng.uniform(0.0, 0.01) * towards / np.linalg.norm(towards)
    w.links[d.joint + 1] = (mass, com)
    return {"link": float(d.joint + 1), "mass_kg": mass, "com_m": com.tolist()}


@effect("position_dependent_torque", "fourier", "sweeps", "poses", excludes=OVER_ANGLE)
def _smooth(w: World, d: Draw) -> Values:
    j, height = d.joint, d.sign * d.between(0.6, 3.0) * d.friction
    if d.rng.random() < 0.5:
        middle = CENTRE[j] + d.rng.uniform(-0.4, 0.4) * REACH[j]
        across = np.radians(d.rng.uniform(30.0, 90.0))
        w.hump[j] = height, middle, across / HALF_HEIGHT
        return {}
    phase, share = d.rng.uniform(-np.pi, np.pi, 2), d.rng.uniform(0.3, 1.0)
    for k in range(int(d.rng.integers(1, 3))):
        size = height if k == 0 else share * height
        w.harmonics[j, k] = size * np.cos(phase[k]), size * np.sin(phase[k])
    return {"coefficients_nm": [0.0, *(float(x) for x in w.harmonics[j].ravel())]}


@effect("base_tilt", "fourier", "poses", arm_wide=True)
def _tilt(w: World, d: Draw) -> Values:
    w.tilt = (d.between(0.01, 0.1), float(d.rng.uniform(-np.pi, np.pi)))
    return {"tilt_rad": w.tilt[0], "azimuth_rad": w.tilt[1]}


@effect("link_inertia", "fast", "chirp")
def _inertia(w: World, d: Draw) -> Values:
    j, sign = d.joint, d.sign if w.rotor[d.joint] else 1.0
    w.armature[j] = sign * d.between(0.3, 0.7) * ROTOR[j]
    return {"armature_kgm2": w.armature[j]}


@effect("backlash", "fourier", "reversals", "fast", joints=(1, 3, 5), needs_friction=True)
def _gap(w: World, d: Draw) -> Values:
    w.gap = (d.joint, d.between(5e-3, 3e-2))
    return {"gap_rad": w.gap[1]}


@effect("joint_elasticity", "chirp", joints=(1, 2, 3, 4), needs_friction=True)
def _elasticity(w: World, d: Draw) -> Values:
    w.soft = (d.joint, d.between(5000.0, 1000.0))
    return {"stiffness_nm_per_rad": w.soft[1]}


@effect("actuator_delay", "fast", "chirp", arm_wide=True)
def _delay(w: World, d: Draw) -> Values:
    w.delay = d.between(4e-3, 3e-2)
    return {"delay_s": w.delay}


# joint 1 turns about the vertical, and what joint 7 carries is about its axis
@effect("encoder_offset", "fourier", "poses", "fast", joints=(2, 3, 4, 5, 6))
def _zero(w: World, d: Draw) -> Values:
    w.zero[d.joint] = d.sign * d.between(0.01, 0.15)
    return {"offset_rad": w.zero[d.joint]}


@effect("gravity_compensation_missing", "fourier", "poses", "fast", arm_wide=True)
def _missing(w: World, d: Draw) -> Values:
    # most controllers that log their own command leave out all of it
    w.gravity_missing = 1.0 if d.rng.random() < 0.3 else d.between(0.02, 1.0)
    return {"share": w.gravity_missing}


@effect("external_spring", "fourier", "poses", "sweeps", excludes=OVER_ANGLE)
def _spring(w: World, d: Draw) -> Values:
    j = d.joint
    w.spring[j] = d.between(0.4, 4.0) * d.friction
    w.spring_rest[j] = d.rng.uniform(-0.6, 0.6) + [0, -0.4, 0, -1.9, 0, 1.9, 0.5][j]
    return {"stiffness_nm_per_rad": w.spring[j], "rest_rad": w.spring_rest[j]}
