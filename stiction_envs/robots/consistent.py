"""Physically consistent bodies: nearest to a fit, and a little off a known body.

The nearest are convex programs over pseudo-inertias, solved by Clarabel (P. Goulart, Y. Chen,
"Clarabel: an interior-point solver for conic programs with quadratic objectives", 2024).
J' = A J Aᵀ of the pseudo-inertia J, with A near one, exists for every A (C. Rucker, P. Wensing,
"Smooth parameterization of rigid-body inertia", IEEE RA-L 2022).
"""

import clarabel
import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csc_matrix

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.robots.regressor import consistent, from_pseudo_inertia, pseudo_inertia

_PAIRS = [(a, b) for a in range(4) for b in range(a + 1)]
_UNITS = np.zeros((10, 4, 4))
for _k, (_a, _b) in enumerate(_PAIRS):
    _UNITS[_k, _a, _b] = _UNITS[_k, _b, _a] = 1.0
_TWICE = np.array([1.0 if a == b else 2.0 for a, b in _PAIRS])
"""How often an entry of the lower triangle is in the matrix."""
ROUND_BODY = 0.05
"""Part of a round body of the link's own mass and size in the unit of its deviations [-]; assumed.
Without it a thin nominal body could not become thicker."""
LEAST_EIGENVALUE = 1e-6
"""Least eigenvalue of pseudo-inertias, in units of the nominal link's [-]; assumed: a body has an
extent."""
_STRETCHES = np.zeros((10, 4, 4))
_STRETCHES[0] = 0.5 * np.eye(4)
_STRETCHES[[1, 2, 3], [0, 1, 2], 3] = 1.0
for _k, (_a, _b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), start=4):
    _STRETCHES[_k, _a, _b] = _STRETCHES[_k, _b, _a] = 1.0
STRETCH_SD = np.array([0.1, *[0.015] * 3, *[0.2] * 6])
"""(10,) prior standard deviations of a link's mass over its own [-], of its centre [m], of stretch
and shear [-]; assumed: as far as published and identified bodies of a link usually differ."""


def _units(phi: Array) -> Array:
    """Return (n, 10, 10) maps from lower triangles of S to the ten parameters of links (n, 10).

    J = C S Cᵀ, and S is near the identity for the nominal bodies; bodies that cannot exist are made
    consistent.
    """
    j = pseudo_inertia(phi)
    mass = np.maximum(np.abs(j[:, 3, 3]), 1e-3)
    spread = np.maximum(np.trace(j[:, :3, :3], axis1=1, axis2=2) / 3, 1e-6 * mass)
    ball = np.zeros_like(j)
    for k in range(3):
        ball[:, k, k] = spread
    ball[:, 3, 3] = mass
    values, vectors = np.linalg.eigh(j)
    possible = (vectors * np.maximum(values, 0.0)[:, None]) @ vectors.transpose(0, 2, 1)
    c = np.linalg.cholesky(possible + ROUND_BODY * ball)
    each = c[:, None] @ _UNITS @ c[:, None].transpose(0, 1, 3, 2)
    return from_pseudo_inertia(each).transpose(0, 2, 1)


def nearest_bodies(phi: Array, hessian: Array, nominal: Array) -> Array:
    """Return (n, 10) links that exist and minimise ½ (x − φ)ᵀH(x − φ).

    ``phi`` (n, 10) are links that need not exist, ``hessian`` (10 n, 10 n) is H, and ``nominal``
    (n, 10) are links that give the units.

    Raises:
        StictionError: the solver finds none.
    """
    if consistent(phi).all():
        return phi
    # x are the bodies' lower triangles, in which each is positive definite
    n, wide = len(phi), block_diag(*_units(nominal))
    inner = wide.T @ hessian @ wide
    slope = inner @ np.linalg.solve(wide, phi.ravel())
    rows = -np.diag(np.tile(np.sqrt(_TWICE), n))
    least = np.tile(-LEAST_EIGENVALUE * (_TWICE == 1.0), n)
    cones = [clarabel.PSDTriangleConeT(4)] * n
    options = clarabel.DefaultSettings()
    options.verbose = False
    # one thread, so that the same input gives the same bits
    options.max_threads = 1
    found = clarabel.DefaultSolver(
        *(csc_matrix(np.triu(inner)), -slope, csc_matrix(rows), least, cones, options)
    ).solve()
    if found.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
        raise StictionError(f"no links fit these logs: the solver says {found.status}")
    return np.asarray((wide @ np.array(found.x)).reshape(n, 10))


def tolerances(phi: Array) -> Array:
    """Return (10 n, 10 n) F, F Fᵀ being the covariance of links (n, 10) as makers know them."""
    n = len(phi)
    out = np.zeros((n, 10, n, 10))
    for k, own in enumerate(phi):
        out[k, :, k] = stretch_directions(own) * STRETCH_SD
    return out.reshape(10 * n, 10 * n)


def stretch_directions(phi: Array) -> Array:
    """Return (10, 10) change of a link's parameters per mass, shift [m], and stretch or shear [-].

    The tangent of `stretched_link`; mass is relative to the link's mass.
    """
    j, to = pseudo_inertia(phi), np.eye(4)
    to[:3, 3] = phi[1:4] / phi[0]  # the centre of mass
    moved = [to @ x @ np.linalg.inv(to) @ j for x in _STRETCHES]
    return np.stack([from_pseudo_inertia(x + x.T) for x in moved], axis=1)
