"""Arms whose links are all a little off, as cables and CAD tolerances leave them.

That is no hidden cause: it is what a diagnosis must tolerate.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.robots import Arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import from_pseudo_inertia, inertial_parameters, pseudo_inertia

CENTRE_M = 0.1
"""Standard deviation of a centre of mass per unit of scatter [m]: at 3 % 3 mm; assumed."""
MOST = 0.2  # largest scatter [-] (assumed): masses stay positive up to five standard deviations


def scattered(phi: ArrayLike, scatter: float, rng: np.random.Generator) -> Array:
    """Return (n, 10) parameters of links that all differ a little from those given.

    Of each link the mass is multiplied by 1 + N(0, s), the centre moved by N(0, s · `CENTRE_M`)
    along each axis, and the link stretched and rotated about its centre by A = I + N(0, s) (3, 3):
    J' = (m'/m) T J Tᵀ with T the affine map of all this, which keeps J positive definite
    (`pseudo_inertia`). s is ``scatter``; one out of range is refused.
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
