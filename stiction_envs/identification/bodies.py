"""Physically consistent links: least squares of torques over positive-definite pseudo-inertias.

A convex program (P. Wensing, S. Kim, J.-J. Slotine, "Linear matrix inequalities for physically
consistent inertial parameter identification", IEEE RA-L 2018), solved by Clarabel (P. Goulart,
Y. Chen, "Clarabel: an interior-point solver for conic programs with quadratic objectives", 2024):

    min ½ ‖R p − z‖² + ½ Σ_i ‖C_i⁻¹ (J_i − J⁰_i) C_i⁻ᵀ‖²/s²  with J_i positive definite, f ≥ 0

with the pseudo-inertias J_i of the links, their nominal values J⁰_i, and friction f. The second
term keeps what torques do not determine near the nominal, in a measure without a frame (T. Lee,
P. Wensing, F. Park, "Geometric robot dynamic identification: a convex programming approach", IEEE
T-RO 2020). Friction is kept under its usual size in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from stiction_envs.errors import StictionError
from stiction_envs.identification.base_parameters import Design, Fit, correlated_rows, normal_sums
from stiction_envs.identification.settings import IdentificationSettings, identification_settings
from stiction_envs.robots.regressor import from_pseudo_inertia, pseudo_inertia

Array = NDArray[np.float64]
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
"""Of pseudo-inertias in units of the nominal link's [-]; assumed: a body must have an extent."""
LEAST_FRICTION = 1e-4
"""Friction below this part of its usual size counts as zero [-]; assumed: it is on its bound."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """Units of the links: J = C S Cᵀ, and S is near the identity for the nominal bodies."""

    c: Array
    """(n, 4, 4)."""
    maps: Array
    """(n, 10, 10) from the lower triangle of S to a link's ten parameters."""
    nominal: Array
    """(n, 10) lower triangles of S for the nominal bodies."""


def frames(phi: Array) -> Frames:
    """Return the units of nominal links (n, 10); those that cannot exist are made consistent."""
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
    inverse = np.linalg.inv(c)
    unit = inverse @ j @ inverse.transpose(0, 2, 1)
    each = c[:, None] @ _UNITS @ c[:, None].transpose(0, 1, 3, 2)
    return Frames(
        c=c,
        maps=from_pseudo_inertia(each).transpose(0, 2, 1),
        nominal=np.stack([unit[:, a, b] for a, b in _PAIRS], axis=1),
    )


def consistent_fit(d: Design, found: Fit, settings: IdentificationSettings | None = None) -> Array:
    """Return (P,) parameters of physically consistent links, with friction that is not negative.

    Args:
        d: torques and columns.
        found: unconstrained fit on the base parameters, for weights and correlation.
        settings: constants of the method; None for those of ``settings.toml``.
    """
    trust = (settings or identification_settings()).bodies.trust
    n, links = d.n, d.links
    a, b = normal_sums(d.columns, d.torque, found.weight / correlated_rows(found.residual))
    units = frames(d.nominal[:links].reshape(n, 10))
    wide = np.eye(len(a))
    for i in range(n):
        part = slice(10 * i, 10 * i + 10)
        wide[part, part] = units.maps[i]
    wide[links:, links:] = np.diag(d.usual)
    hessian, slope = wide.T @ a @ wide, wide.T @ b
    prior = np.concatenate([np.tile(_TWICE, n) / trust**2, np.ones(len(a) - links)])
    slope[:links] += prior[:links] * units.nominal.ravel()
    hessian[np.diag_indices_from(hessian)] += prior
    x = least_consistent(hessian, slope, n)
    friction = x[links:-n]  # rotor, Coulomb, viscous; the offset is last and may be negative
    friction[friction < LEAST_FRICTION] = 0.0
    return np.asarray(wide @ x)


def least_consistent(hessian: Array, slope: Array, n: int) -> Array:
    """Return the minimum of ½ xᵀHx − hᵀx where n bodies exist and friction is not negative.

    Args:
        hessian: (P, P) H, positive definite.
        slope: (P,) h.
        n: number of links: x is n lower triangles (10), friction ≥ 0, and n free numbers.
    """
    signed, diagonal = len(slope) - n, np.where(_TWICE == 1.0, 1.0, 0.0)
    rows = -np.eye(signed, len(slope))
    rows[: 10 * n] *= np.tile(np.sqrt(_TWICE), n)[:, None]
    least = np.concatenate([np.tile(-LEAST_EIGENVALUE * diagonal, n), np.zeros(signed - 10 * n)])
    cones = [clarabel.PSDTriangleConeT(4)] * n + [clarabel.NonnegativeConeT(signed - 10 * n)]
    options = clarabel.DefaultSettings()
    options.verbose = False
    # one thread, so that the same input gives the same bits
    options.max_threads = 1
    found = clarabel.DefaultSolver(
        *(csc_matrix(np.triu(hessian)), -slope, csc_matrix(rows), least, cones, options)
    ).solve()
    if found.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
        raise StictionError(f"no links fit these logs: the solver says {found.status}")
    return np.array(found.x)
