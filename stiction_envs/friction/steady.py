"""Bound the friction of a written model to what a step of the engine holds, in any pose.

A bristle's torque σ0 z + σ1 ż is that of a step's start. After a reversal ż is up to (1 + r) times
the speed, r being the joint's largest dry friction over its least, so a step is stable while
h σ1 (1 + r) < 2 J (sources.md 3.5). J is the least inertia that the joint feels: all others free.
"""

from collections.abc import Callable

import numpy as np

from stiction_envs.arrays import Array, Bools
from stiction_envs.friction.inertia import link_inertia, mass_and_gravity
from stiction_envs.friction.parameters import CONTROL_DT, QUANTITIES, FrictionParameters
from stiction_envs.robots import Arm

POSES = 256  # Random poses in which the least inertia is looked for [-]; assumed
STIFFEST = 0.1
"""Largest bristle stiffness over inertia/timestep² with r = 1 [-]; assumed: a twentieth of the
chattering limit."""
FASTEST_DECAY = 0.5
"""Largest bristle damping over inertia/timestep with r = 1 [-]; assumed: up to four joints in line
may reverse at once, and a step is stable while the sum of (1 + r)/2 times this is below 2."""
STIFFEST_SPRING = 1.0
"""Largest stiffness of a joint's spring over inertia/timestep² [-]; assumed: a quarter of what a
step is stable with, 160 Hz."""


def steady(
    friction: FrictionParameters, *arms: Arm, say: Callable[[int, str], None] = lambda _, __: None
) -> FrictionParameters:
    """Return friction of an arm, used on ``arms``, with which no joint shakes at steps of 1 ms.

    ``say`` is called with each joint (from 0) that is bounded, and by what.
    """
    rng, h = np.random.default_rng(0), CONTROL_DT
    low, high = np.clip(arms[0].limits.position, -np.pi, np.pi).T
    poses = rng.uniform(low, high, size=(POSES, friction.n))
    poses = np.vstack([arms[0].rest, poses])
    mass = np.concatenate([mass_and_gravity(arm, poses)[0] for arm in arms])
    rotor, spring = friction.rotor_inertia, friction.joint_stiffness

    def least(elastic: Bools) -> Array:
        own = mass + np.diag(np.where(elastic, 0.0, rotor))
        return np.asarray(np.min(1 / np.diagonal(np.linalg.inv(own), axis1=1, axis2=2), axis=0))

    link = least(friction.elastic)
    swinging = rotor * link / (rotor + link)
    stiff = friction.elastic & (spring * h * h > STIFFEST_SPRING * swinging)
    for j in np.flatnonzero(stiff):
        say(int(j), f"its spring of {spring[j]:.4g} N·m/rad is rigid in steps of 1 ms")
    elastic = friction.elastic & ~stiff
    carried = np.where(elastic, rotor, least(elastic))
    dry = friction.stiction * friction.coulomb_ratio
    carried /= (1 + friction.stiction.max(axis=1) / dry.min(axis=1)) / 2
    most = np.maximum(STIFFEST * carried / h**2, QUANTITIES["bristle_stiffness"].low)
    for j in np.flatnonzero(friction.bristle_stiffness > most):
        say(int(j), f"{most[j]:.4g} N·m/rad is the stiffest bristle that holds still")
    bristle = np.minimum(friction.bristle_stiffness, most)
    at_rest = np.max([link_inertia(arm, arm.rest[None])[0] for arm in arms], axis=0)
    critical = 2 * np.sqrt(bristle * (rotor + np.where(elastic, 0.0, at_rest)))
    most_damped = FASTEST_DECAY * carried / (h * critical)
    return friction.replace(
        joint_stiffness=np.where(stiff, np.inf, spring),
        bristle_stiffness=bristle,
        bristle_damping_ratio=np.minimum(friction.bristle_damping_ratio, most_damped),
    )
