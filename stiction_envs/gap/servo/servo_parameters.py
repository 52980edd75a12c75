"""Parameters of one joint under a position servo, and what a cause changes of them.

    u = clip(K (r − q), ±limit)                servo; r: the command, late and rate-limited
    (M + A) q̈ = u − d q̇ − τ_f − (g(q) − b) − τ_c      joint; τ_c: torque of the other joints' motion
    τ_f: LuGre with level (F_s + μ |g|)(1 − s + s exp(−(q̇/v_s)²))            friction

The log shows q + offset. A dead zone is taken off the error K multiplies.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from stiction_envs.arrays import Array

FAR = 1e9
"""Value of a limit that is never reached [SI]."""
BOTH_SIDES = "poses on both sides of where gravity's torque on the joint is zero"
"""A measurement that tells causes apart."""
ALONE = 3
"""Number of a stage."""


@dataclass(frozen=True)
class ServoParameter:
    """One parameter of a joint."""

    unit: str
    low: float
    high: float
    """Bounds in its unit; per N·m/rad of the servo's stiffness for those `OF_TORQUE`."""
    absent: float
    """The value at which it has no effect."""
    scale: Literal["unit", "stiffness", "ratio"] = "unit"
    """Whether sizes of its change are in its own unit, times the servo's stiffness, or of its
    logarithm."""
    friction: tuple[str, ...] = ()
    """Quantities of the arm's friction that depend on it."""
    not_in_mjcf: str = ""
    """What MuJoCo lacks of its value {x}."""


PARAMETERS = {
    "stiffness": ServoParameter("N·m/rad", 0.005, 2e3, np.nan, "ratio"),
    "damping": ServoParameter("N·m·s/rad", 0.0, 2e2, 0.0, "stiffness", ("viscous",)),
    "armature": ServoParameter("kg·m²", 0.0, 0.5, 0.0, "stiffness", ("rotor_inertia",)),
    "delay": ServoParameter(
        *("s", -0.1, 0.2, 0.0),
        not_in_mjcf="its command acts {x:.4g} s later (negative: earlier); do it yourself",
    ),
    "stiction": ServoParameter("N·m", 0.0, 10.0, 0.0, "stiffness", ("stiction", "coulomb_ratio")),
    "drop": ServoParameter("1", 0.0, 0.95, 0.0, friction=("coulomb_ratio",)),
    "stribeck_velocity": ServoParameter("rad/s", 0.01, 1.0, 0.1, "ratio", ("stribeck_velocity",)),
    "load": ServoParameter(
        *("1", 0.0, 1.5, 0.0),
        friction=("load_coefficient",),
        not_in_mjcf="friction grows by {x:.3g} of gravity's torque; held at the usual one",
    ),
    "bristle": ServoParameter("rad", 2e-4, 0.06, 1e-3, "ratio", ("bristle_stiffness",)),
    "torque_limit": ServoParameter("N·m", 0.002, FAR, FAR, "ratio"),
    "speed_limit": ServoParameter(
        *("rad/s", 0.05, FAR, FAR, "ratio"),
        not_in_mjcf="its command moves at most {x:.4g} rad/s; limit it yourself",
    ),
    "dead_zone": ServoParameter(
        *("rad", 0.0, 0.1, 0.0), not_in_mjcf="a dead zone of ±{x:.4g} rad around its command"
    ),
    "offset": ServoParameter(
        *("rad", -0.3, 0.3, 0.0),
        not_in_mjcf="the logged angle is {x:.4g} rad larger than the model's",
    ),
    "compensation": ServoParameter(
        *("1", -0.5, 1.2, 0.0),
        friction=("gravity_error",),
        not_in_mjcf="its controller adds {x:.3g} of gravity",
    ),
}
"""In the order of the compiled simulation. Bounds are those that joints have, all assumed."""
NAMES = tuple(PARAMETERS)
INDEX = {name: i for i, name in enumerate(NAMES)}
OF_TORQUE = np.array([p.unit.startswith(("N·m", "kg·m²")) for p in PARAMETERS.values()])
"""(P,) whether a parameter grows with the size of the arm."""
_LOW, _HIGH = (np.array([getattr(p, end) for p in PARAMETERS.values()]) for end in ("low", "high"))
LOW = np.where(OF_TORQUE, np.minimum(_LOW, 1e-9), _LOW)
HIGH = np.where(OF_TORQUE, np.inf, _HIGH)
"""(P,) bounds of an arm of any size."""
LIMITS = tuple(name for name, p in PARAMETERS.items() if p.absent == FAR)
"""Parameters that a joint shows where it reaches them."""


def bounds(stiffness: float) -> tuple[Array, Array]:
    """Return (P,) lowest and highest parameters of a joint whose servo is about so stiff [N·m/rad].

    A servo of an industrial arm is a thousand times as stiff as that of a toy, and so is all else.
    """
    unit = np.where(OF_TORQUE, stiffness, 1.0)
    return unit * _LOW, np.minimum(unit * _HIGH, FAR)


def absent() -> Array:
    """Return (P,) parameters of a joint without friction, lag and limits; stiffness is NaN."""
    return np.array([p.absent for p in PARAMETERS.values()])


@dataclass(frozen=True, kw_only=True, eq=False)
class InServo:
    """What a cause changes in a joint under a position servo, and its words."""

    sizes: Mapping[str, float] = field(default_factory=dict)
    """Usual size of the change of each parameter, as of its `scale`: the standard deviation of its
    prior. Empty for a cause that the evidence of one joint does not show."""
    starts: Callable[[Mapping[str, float]], list[dict[str, float]]] = lambda _: []
    """Returns values from which a fit starts, by parameter, given the joint's parameters, its usual
    ``error`` [rad] and ``gravity`` [N·m], and the ``torque`` and ``speed`` that it reaches."""
    reported: Mapping[str, tuple[tuple[str, ...], Callable[..., Array]]] = field(
        default_factory=dict
    )
    """Parameters on which one of ``diagnosis.json`` depends, and the function that returns it; the
    others are those of `sizes`, in their order."""
    odds: float | None = None
    """Log odds against it; None for those of one among all hypotheses [nats]."""
    stage: int = ALONE
    """Causes of one stage, from 0, are added together to the model of everything; of stage `ALONE`
    one by one."""
    of_every_joint: bool = False
    """Whether every joint has it, named or not: what moves the joint is fitted with it."""
    of_gravity: bool = False
    """Whether only a joint shows it whose servo's torque gravity scales."""
    of_known_servo: bool = False
    """Whether only a servo of known stiffness shows it."""
    evidence: str = ""
    """What a person can check in the plot of angles, a sentence; {value} is its first value."""
    below_zero: str = ""
    """The same where that value is below zero."""
    alike: tuple[str, ...] = ()
    """Causes that positions alone cannot tell from it, or only just, whatever the motion."""
    tells_apart: str = "a motion in which the two act differently"
    """The measurement that tells it from another, a clause."""
