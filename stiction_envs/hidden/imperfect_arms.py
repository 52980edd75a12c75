"""Arms that are a little off everywhere: links and set-up as cables and CAD tolerances leave them.

Every link of a real arm differs somewhat from what its makers know, and so do its sensors. None of
that is a hidden cause: it is what a diagnosis must tolerate.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.errors import StictionError
from stiction_envs.hidden.torque_effects import FRICTION
from stiction_envs.hidden.worlds import World
from stiction_envs.robots import Arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import (
    from_pseudo_inertia,
    inertial_parameters,
    pseudo_inertia,
)

Array = NDArray[np.float64]
CENTRE_M = 0.1
"""Standard deviation of a centre of mass per unit of scatter [m]: at 3 % 3 mm; assumed."""
MOST = 0.2
"""Largest scatter [-] (assumed): masses stay positive up to five standard deviations."""
OFFSET = 0.1 * FRICTION
"""(7,) standard deviation of torque offsets [N·m]; assumed."""
GAIN = 3e-3
"""Standard deviation of torque gains [-]; assumed."""
DELAY = 1e-3
"""Of all torques [s]; assumed."""
TILT = 1e-3
"""Of the base, in a random direction [rad]; assumed."""


def scattered(phi: ArrayLike, scatter: float, rng: np.random.Generator) -> Array:
    """Return (n, 10) parameters of links that all differ a little from those given.

    Of each link the mass is multiplied by 1 + N(0, s), the centre moved by N(0, s · `CENTRE_M`)
    along each axis, and the link stretched and rotated about its centre by A = I + N(0, s) (3, 3):
    J' = (m'/m) T J Tᵀ with T the affine map of all this, which keeps J positive definite
    (`pseudo_inertia`).

    Args:
        phi: (n, 10) parameters of physically consistent links.
        scatter: s [-].
        rng: for the draws.

    Raises:
        StictionError: a scatter out of range.
    """
    if not 0 <= scatter <= MOST:
        raise StictionError(f"scatter {scatter:g}: expected 0 to {MOST:g}")
    before = np.asarray(phi, dtype=np.float64)
    n = len(before)
    mass = 1 + scatter * rng.normal(size=n)
    shift = scatter * CENTRE_M * rng.normal(size=(n, 3))
    stretch = np.eye(3) + scatter * rng.normal(size=(n, 3, 3))
    centre = before[:, 1:4] / before[:, :1]
    affine = np.tile(np.eye(4), (n, 1, 1))
    affine[:, :3, :3] = stretch
    affine[:, :3, 3] = centre + shift - (stretch @ centre[..., None])[..., 0]
    moved = affine @ pseudo_inertia(before) @ affine.transpose(0, 2, 1)
    return from_pseudo_inertia(mass[:, None, None] * moved)


def with_scattered_links(arm: Arm, scatter: float, rng: np.random.Generator) -> Arm:
    """Return an arm with links that are all a little off: see `scattered`."""
    return with_inertias(arm, scattered(inertial_parameters(arm.pinocchio()), scatter, rng))


def scatter_set_up(world: World, rng: np.random.Generator) -> None:
    """Give a world small offsets, gains, a delay and a tilt."""
    world.offset = OFFSET * rng.normal(size=7)
    world.scale = 1 + GAIN * rng.normal(size=7)
    world.delay = DELAY
    world.tilt = TILT, float(rng.uniform(-np.pi, np.pi))


def with_exact_set_up(world: World) -> World:
    """Return a world without offsets, gains, delay and tilt."""
    exact = World()
    return dataclasses.replace(
        world, offset=exact.offset, scale=exact.scale, delay=exact.delay, tilt=exact.tilt
    )
