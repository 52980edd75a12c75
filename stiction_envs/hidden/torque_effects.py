"""Effects that are hidden in joint logs: one entry per effect, by the name of the diagnosis.

An entry changes the `World` before it is simulated and returns the truth. Simulated logs
(`hidden_logs`) draw its value; a rehearsal hides three values along the motion of a user's log. It
shares only the name and the keys of the parameters with the cause of the diagnosis. A payload that
only the model has is an effect with its own name, ``phantom_payload``; as a cause it is a payload
of negative mass.
"""

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.hidden.worlds import REACH, World
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import inertial_parameters

Values = dict[str, float | list[float]]
FRICTION = np.array([0.7, 0.9, 0.7, 0.8, 0.5, 0.4, 0.5])
"""(7,) usual dry friction [N·m]; assumed."""
ROTOR = np.array([0.3, 0.4, 0.3, 0.3, 0.12, 0.12, 0.1])
"""(7,) usual rotor inertia [kg·m²]; assumed."""
PANDA_LINK_KG = np.array([4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522])
"""(7,) of the arm that is simulated [kg]. Source: ``robots/panda.xml``."""
HALF_HEIGHT = 2 * np.sqrt(2 * np.log(2))
"""Width of a Gaussian at half its height, in standard deviations."""
COM = np.array([0.02, 0.01, 0.05])
"""Centre of mass of a rehearsed payload from the flange [m]; assumed."""


@dataclass(frozen=True, kw_only=True)
class Draw:
    """Random numbers of one hidden cause."""

    joint: int
    """From 0."""
    sign: float
    size: float
    """0 (just visible) to 1 (large)."""
    rng: np.random.Generator
    """For what else an effect draws."""

    def between(self, low: float, high: float) -> float:
        """Return the value of this size, even in the logarithm."""
        return float(low * (high / low) ** self.size)

    def signed(self, low: float, high: float) -> float:
        """Return the same with the sign."""
        return self.sign * self.between(low, high)

    def more(self, low: float, high: float, known: Array, usual: float) -> float:
        """Return a share of the joint's ``known`` value, with sign; of ``usual`` if that is 0."""
        sign = self.sign if known[self.joint] else 1.0
        return float(sign * self.between(low, high) * (known[self.joint] or usual))

    @property
    def friction(self) -> float:
        """Usual dry friction of the joint [N·m]."""
        return float(FRICTION[self.joint])


Shape = np.random.Generator | None
"""Draws what an effect has besides its value; None: a rehearsal's usual shape."""
Hide = Callable[[World, int, float, Shape], Values]
"""Changes the world on a joint (from 0); returns the truth under the keys of ``diagnosis.json``,
its value's first."""


def sets(name: str, key: str) -> Hide:
    """Return how to hide the value of a key: as a field of the world, or a joint's value there."""

    def hide(w: World, j: int, value: float, shape: Shape) -> Values:
        if isinstance(field := getattr(w, name), np.ndarray):
            field[j] = value
        else:
            setattr(w, name, value)
        return {key: value}

    return hide


def _stribeck(w: World, j: int, value: float, shape: Shape) -> Values:
    w.stribeck[j] = value
    if shape is not None:
        w.stribeck_velocity[j] = np.exp(shape.uniform(np.log(0.03), np.log(0.12)))
    return {"stiction_nm": value, "stribeck_velocity": w.stribeck_velocity[j]}


def _presliding(w: World, j: int, value: float, shape: Shape) -> Values:
    w.distance[j] = value
    return {"bristle_stiffness": w.coulomb[j] / value}


def _ripple(w: World, j: int, value: float, shape: Shape) -> Values:
    periods, phase = 24.0, 0.7
    if shape is not None:
        periods, phase = float(shape.integers(12, 50)), shape.uniform(-np.pi, np.pi)
    w.ripple[j], w.periods[j], w.phase[j] = value, periods, phase
    return {"ripple_nm": value, "periods_per_rev": periods, "phase_rad": phase}


def _payload(w: World, j: int, value: float, shape: Shape) -> Values:
    com = COM if shape is None else shape.uniform(-0.06, 0.06, 3) + np.array([0, 0, 0.05])
    w.payload = (value, com)
    return {"mass_kg": value, "com_m": com.tolist()}


def _phantom(w: World, j: int, value: float, shape: Shape) -> Values:
    com = COM if shape is None else shape.uniform(-0.03, 0.03, 3) + np.array([0, 0, 0.05])
    w.phantom = (value, com)
    return {"mass_kg": -value, "com_m": com.tolist()}


def _link(w: World, j: int, value: float, shape: Shape) -> Values:
    if shape is None:  # another density
        links = inertial_parameters(w.rigid.pinocchio())
        links[j] *= 1 + value / links[j, 0]
        w.rigid = with_inertias(w.rigid, links)
        return {"mass_kg": value}
    towards = shape.normal(size=3)
    com = shape.uniform(0.0, 0.01) * towards / np.linalg.norm(towards)
    w.links[j + 1] = (value, com)
    return {"mass_kg": value, "com_m": com.tolist(), "link": float(j + 1)}


def _smooth(w: World, j: int, value: float, shape: Shape) -> Values:
    if shape is None:
        w.hump[j] = value, w.middle[j], np.radians(60.0) / HALF_HEIGHT
        return {}
    if shape.random() < 0.5:
        middle = w.middle[j] + shape.uniform(-0.4, 0.4) * REACH[j]
        across = np.radians(shape.uniform(30.0, 90.0))
        w.hump[j] = value, middle, across / HALF_HEIGHT
        return {}
    phase, share = shape.uniform(-np.pi, np.pi, 2), shape.uniform(0.3, 1.0)
    for k in range(int(shape.integers(1, 3))):
        size = value if k == 0 else share * value
        w.harmonics[j, k] = size * np.cos(phase[k]), size * np.sin(phase[k])
    return {"coefficients_nm": [0.0, *(float(x) for x in w.harmonics[j].ravel())]}


def _tilt(w: World, j: int, value: float, shape: Shape) -> Values:
    towards = np.pi / 4 if shape is None else float(shape.uniform(-np.pi, np.pi))
    w.tilt = (value, towards)
    return {"tilt_rad": value, "azimuth_rad": towards}


def _elasticity(w: World, j: int, value: float, shape: Shape) -> Values:
    w.soft = (j, value)
    return {"stiffness_nm_per_rad": value}


def _spring(w: World, j: int, value: float, shape: Shape) -> Values:
    rest = w.middle[j] if shape is None else shape.uniform(-0.6, 0.6) + w.middle[j]
    w.spring[j], w.spring_rest[j] = value, rest
    return {"stiffness_nm_per_rad": value, "rest_rad": rest}


def _of_friction(w: World, j: int, size: float) -> float:
    """Return a size that is a part of the dry friction."""
    return float(size * w.coulomb[j])


@dataclass(frozen=True)
class TorqueEffect:
    """A rule that hides a cause in a joint log."""

    hide: Hide

    # in simulated logs

    draw: Callable[[World, Draw], float]
    """Returns a value that robots have."""
    motions: tuple[str, ...]
    """Names of the `MOTIONS` that excite the cause."""
    _: KW_ONLY
    joints: tuple[int, ...] = (1, 2, 3, 4, 5, 6, 7)
    """From 1, those on which it can be seen at all."""
    needs_friction: bool = False
    """Whether it acts on rotors that are there already; a cause that refines dry friction does."""
    arm_wide: bool = False
    excludes: frozenset[str] = frozenset()
    """Effects that are not hidden with it, as no log separates them."""

    # in a rehearsal

    value: Callable[[World, int, float], float] = lambda w, j, size: size
    """The value of a size ≥ 0, with which the torque grows; without size there is none."""
    largest: float = np.inf
    """Largest size to try: more is obvious; assumed."""
    expected: tuple[str, ...] = ()
    """Causes that are named rightly beside it: the dry friction that it refines, and that must be
    there."""
    parameter: str = ""
    """Parameter that the value is, where that is not the cause's first."""


def cause_of(name: str) -> str:
    """Return the cause of an effect, as the diagnosis has it."""
    return "payload" if name == "phantom_payload" else name


DRY = ("coulomb_friction",)
OVER_ANGLE = frozenset({"torque_offset", "external_spring", "position_dependent_torque"})
"""On one joint an offset and a spring are a smooth torque over the angle."""
ON_FLANGE = frozenset({"payload", "phantom_payload"})
"""The one takes the other away."""
EFFECTS = {
    "coulomb_friction": TorqueEffect(
        sets("more_coulomb", "coulomb_nm"),
        lambda w, d: d.more(0.3, 0.8, w.coulomb, d.friction),
        ("fourier", "reversals", "sweeps"),
    ),
    "viscous_friction": TorqueEffect(
        sets("more_viscous", "viscous_nms"),
        lambda w, d: d.more(0.4, 0.9, w.viscous, 2 * d.friction),
        ("fourier", "fast", "sweeps"),
    ),
    "stribeck_friction": TorqueEffect(
        _stribeck,
        lambda w, d: d.between(0.3, 1.2) * d.friction,
        ("sweeps", "rests"),
        value=_of_friction,
        largest=3.0,
        expected=DRY,
    ),
    "direction_asymmetry": TorqueEffect(
        sets("asymmetry", "asymmetry_nm"),
        lambda w, d: d.signed(0.2, 0.5) * w.coulomb[d.joint],
        ("rests",),
        value=_of_friction,
        largest=0.9,
        expected=DRY,
    ),
    "load_dependent_friction": TorqueEffect(
        sets("load", "load_coefficient"),
        lambda w, d: d.between(0.02, 0.1),
        ("fourier", "fast"),
        joints=(2, 4),
        largest=1.0,
        expected=DRY,
    ),
    "presliding_hysteresis": TorqueEffect(
        _presliding,
        lambda w, d: d.between(3e-3, 2e-2),
        ("reversals",),
        value=lambda w, j, size: w.distance[j] + size,
        largest=0.1,
        expected=DRY,
    ),
    "position_dependent_friction": TorqueEffect(
        _ripple, lambda w, d: d.between(0.2, 1.0) * d.friction, ("sweeps", "fourier")
    ),
    "warm_up_drift": TorqueEffect(
        sets("drift", "drift_nm_per_s"),
        lambda w, d: d.signed(0.4, 0.8) * w.coulomb[d.joint] / w.seconds,
        ("fourier", "sweeps", "reversals"),
        value=lambda w, j, size: size * w.coulomb[j] / w.seconds,
        largest=1.0,
        expected=DRY,
    ),
    "torque_offset": TorqueEffect(
        sets("offset", "offset_nm"),
        lambda w, d: d.signed(0.2, 1.5) * d.friction,
        ("fourier", "poses", "rests"),
        excludes=OVER_ANGLE,
    ),
    "torque_scale": TorqueEffect(
        sets("scale", "scale"),
        lambda w, d: 1 + d.signed(0.03, 0.2),
        ("fourier", "poses"),
        joints=(2, 4),
        value=lambda w, j, size: 1 + size,
        largest=0.8,
    ),
    "payload": TorqueEffect(
        _payload,
        lambda w, d: d.between(0.1, 2.0),
        ("fourier", "poses", "fast"),
        arm_wide=True,
        excludes=ON_FLANGE,
        largest=20.0,
    ),
    "phantom_payload": TorqueEffect(
        _phantom,
        lambda w, d: d.between(0.35, 0.75),
        ("fourier", "poses", "fast"),
        arm_wide=True,
        excludes=ON_FLANGE,
    ),
    "link_parameters": TorqueEffect(
        _link,
        lambda w, d: d.signed(0.05, 0.3) * PANDA_LINK_KG[d.joint],
        ("fourier", "poses", "fast"),
        # link 1 turns about the vertical only, and a body on link 7 is a payload
        joints=(2, 3, 4, 5, 6),
        arm_wide=True,
        value=lambda w, j, size: size * inertial_parameters(w.rigid.pinocchio())[j, 0],
        largest=0.5,
    ),
    "position_dependent_torque": TorqueEffect(
        _smooth,
        lambda w, d: d.signed(0.6, 3.0) * d.friction,
        ("fourier", "sweeps", "poses"),
        excludes=OVER_ANGLE,
        parameter="height_nm",
    ),
    "base_tilt": TorqueEffect(
        _tilt,
        lambda w, d: d.between(0.01, 0.1),
        ("fourier", "poses"),
        arm_wide=True,
        largest=0.3,
    ),
    "link_inertia": TorqueEffect(
        sets("armature", "armature_kgm2"),
        lambda w, d: (d.sign if w.rotor[d.joint] else 1.0) * d.between(0.3, 0.7) * ROTOR[d.joint],
        ("fast", "chirp"),
    ),
    "joint_elasticity": TorqueEffect(
        _elasticity,
        lambda w, d: d.between(5000.0, 1000.0),
        ("chirp",),
        joints=(1, 2, 3, 4),
        needs_friction=True,
        value=lambda w, j, size: 1 / max(size, 1e-9),
        largest=1 / 300,
    ),
    "actuator_delay": TorqueEffect(
        sets("delay", "delay_s"),
        lambda w, d: d.between(4e-3, 3e-2),
        ("fast", "chirp"),
        arm_wide=True,
        largest=0.1,
    ),
    "encoder_offset": TorqueEffect(
        sets("zero", "offset_rad"),
        lambda w, d: d.signed(0.01, 0.15),
        ("fourier", "poses", "fast"),
        # joint 1 turns about the vertical, and what joint 7 carries is about its axis
        joints=(2, 3, 4, 5, 6),
        largest=0.2,
    ),
    "gravity_compensation_missing": TorqueEffect(
        sets("gravity_missing", "share"),
        # most controllers that log their own command leave out all of it
        lambda w, d: 1.0 if d.rng.random() < 0.3 else d.between(0.02, 1.0),
        ("fourier", "poses", "fast"),
        arm_wide=True,
        largest=1.0,
    ),
    "external_spring": TorqueEffect(
        _spring,
        lambda w, d: d.between(0.4, 4.0) * d.friction,
        ("fourier", "poses", "sweeps"),
        excludes=OVER_ANGLE,
    ),
}
"""Effects by name, in the order in which the causes are registered."""
