"""Bodies that differ a little from a known one, and how much links usually differ.

J' = A J Aᵀ of the pseudo-inertia J, with A near one: a body that exists for every A (C. Rucker,
P. Wensing, "Smooth parameterization of rigid-body inertia", IEEE RA-L 2022).
"""

from __future__ import annotations

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.robots.regressor import from_pseudo_inertia, pseudo_inertia

_STRETCHES = np.zeros((10, 4, 4))
_STRETCHES[0] = 0.5 * np.eye(4)
_STRETCHES[[1, 2, 3], [0, 1, 2], 3] = 1.0
for _k, (_a, _b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), start=4):
    _STRETCHES[_k, _a, _b] = _STRETCHES[_k, _b, _a] = 1.0
STRETCH_SD = np.array([0.1, *[0.015] * 3, *[0.2] * 6])
"""(10,) prior standard deviations of a link's mass over its own [-], of its centre [m], of stretch
and shear [-]; assumed: as far as published and identified bodies of a link usually differ."""


def tolerances(phi: Array) -> Array:
    """Return (10 n, 10 n) F, F Fᵀ being the covariance of links (n, 10) as makers know them."""
    n = len(phi)
    out = np.zeros((n, 10, n, 10))
    for k, own in enumerate(phi):
        out[k, :, k] = stretch_directions(own) * STRETCH_SD
    return out.reshape(10 * n, 10 * n)


def stretch_directions(phi: Array) -> Array:
    """Return (10, 10) change of a link's parameters per mass, shift [m], and stretch or shear [-].

    The tangent of `stretched_link`; mass counts in the link's own.
    """
    j, to = pseudo_inertia(phi), _about_centre(phi)
    moved = [to @ x @ np.linalg.inv(to) @ j for x in _STRETCHES]
    return np.stack([from_pseudo_inertia(x + x.T) for x in moved], axis=1)


def _about_centre(phi: Array) -> Array:
    """Return (4, 4) translation to a body's centre of mass."""
    out = np.eye(4)
    out[:3, 3] = np.asarray(phi)[1:4] / phi[0]
    return out
