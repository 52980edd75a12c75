"""Links that can exist: least squares of torques over bodies with positive-definite pseudo-inertia.

A convex program (P. Wensing, S. Kim, J.-J. Slotine, "Linear matrix inequalities for physically
consistent inertial parameter identification", IEEE RA-L 2018), solved here by an interior-point
method: Newton's on

    ½ ‖R p − z‖² + ½ Σ_i ‖C_i⁻¹ (J_i − J⁰_i) C_i⁻ᵀ‖²/s² − μ Σ_i log det J_i − μ Σ log f

with the pseudo-inertias J_i of the links, their nominal values J⁰_i and friction f ≥ 0, for a μ
that shrinks to nothing. The second term keeps what torques do not show near the nominal, in a
measure that no choice of frame changes (T. Lee, P. Wensing, F. Park, "Geometric robot dynamic
identification: a convex programming approach", IEEE T-RO 2020); friction is kept under its usual
size in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.identification.base_parameters import Design, Fit, correlated_rows, normal_sums
from stiction_envs.identification.settings import (
    BodySettings,
    IdentificationSettings,
    identification_settings,
)
from stiction_envs.robots.regressor import from_pseudo_inertia, pseudo_inertia

Array = NDArray[np.float64]
_PAIRS = [(a, b) for a in range(4) for b in range(a + 1)]
_UNITS = np.zeros((10, 4, 4))
for _k, (_a, _b) in enumerate(_PAIRS):
    _UNITS[_k, _a, _b] = _UNITS[_k, _b, _a] = 1.0
_TWICE = np.array([1.0 if a == b else 2.0 for a, b in _PAIRS])
"""How often an entry of the lower triangle is in the matrix."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """Units of the links: J = C S Cᵀ, and S is near the identity for the nominal bodies."""

    c: Array
    """(n, 4, 4)."""
    maps: Array
    """(n, 10, 10) from the lower triangle of S to a link's ten parameters."""
    nominal: Array
    """(n, 10) lower triangles of S for the nominal bodies."""


def frames(phi: Array, settings: BodySettings | None = None) -> Frames:
    """Return the units of nominal links (n, 10); those that cannot exist are made to for it."""
    s = settings or identification_settings().bodies
    j = pseudo_inertia(phi)
    mass = np.maximum(np.abs(j[:, 3, 3]), 1e-3)
    spread = np.maximum(np.trace(j[:, :3, :3], axis1=1, axis2=2) / 3, 1e-6 * mass)
    ball = np.zeros_like(j)
    for k in range(3):
        ball[:, k, k] = spread
    ball[:, 3, 3] = mass
    values, vectors = np.linalg.eigh(j)
    possible = (vectors * np.maximum(values, 0.0)[:, None]) @ vectors.transpose(0, 2, 1)
    c = np.linalg.cholesky(possible + s.round_body * ball)
    inverse = np.linalg.inv(c)
    unit = inverse @ j @ inverse.transpose(0, 2, 1)
    each = c[:, None] @ _UNITS @ c[:, None].transpose(0, 1, 3, 2)
    return Frames(
        c=c,
        maps=from_pseudo_inertia(each).transpose(0, 2, 1),
        nominal=np.stack([unit[:, a, b] for a, b in _PAIRS], axis=1),
    )


def consistent_fit(d: Design, found: Fit, settings: IdentificationSettings | None = None) -> Array:
    """Return (P,) parameters of links that can exist, with friction that is not negative.

    Args:
        d: torques and columns.
        found: unconstrained fit on the base parameters, for weights and correlation.
        settings: constants of the method; None for those of ``settings.toml``.
    """
    own = settings or identification_settings()
    s = own.bodies
    n, links = d.n, d.links
    rows = correlated_rows(found.residual, own.base_parameters)
    a, b = normal_sums(d.columns, d.torque, found.weight / rows)
    units = frames(d.nominal[:links].reshape(n, 10), s)
    wide = np.eye(len(a))
    for i in range(n):
        part = slice(10 * i, 10 * i + 10)
        wide[part, part] = units.maps[i]
    wide[links:, links:] = np.diag(d.usual)
    hessian, slope = wide.T @ a @ wide, wide.T @ b
    prior = np.concatenate([np.tile(_TWICE, n) / s.trust**2, np.ones(len(a) - links)])
    slope[:links] += prior[:links] * units.nominal.ravel()
    hessian[np.diag_indices_from(hessian)] += prior
    start = np.zeros(len(a))
    start[:links] = np.tile([1.0 if p == q else 0.0 for p, q in _PAIRS], n)
    start[links:-n] = 0.1  # rotor, Coulomb, viscous; the offset is last and may be negative
    x = interior_point(hessian, slope, start, n, s)
    friction = x[links:-n]
    friction[friction < s.least_share] = 0.0
    return np.asarray(wide @ x)


def interior_point(
    hessian: Array, slope: Array, start: Array, n: int, settings: BodySettings | None = None
) -> Array:
    """Return the minimum of ½ xᵀHx − hᵀx where n bodies exist and friction is not negative.

    Args:
        hessian: (P, P) H, positive definite.
        slope: (P,) h.
        start: (P,) a point inside.
        n: number of links: x is n lower triangles (10), friction ≥ 0, and n free numbers.
        settings: constants of the method; None for those of ``settings.toml``.
    """
    s = settings or identification_settings().bodies
    x = start.copy()
    for mu in np.geomspace(s.barrier_first, s.barrier_last, s.barrier_steps):
        value, gradient, curve = _merit(hessian, slope, x, n, mu)
        for _ in range(s.newton_steps):
            step = np.linalg.solve(curve, -gradient)
            decrement = -float(gradient @ step)
            if decrement < s.newton_decrement:
                break
            t = 1.0
            while t > 1e-12:
                new = _merit(hessian, slope, x + t * step, n, mu)
                if new[0] <= value - 1e-4 * t * decrement:
                    break
                t /= 2
            if t <= 1e-12:
                break
            x = x + t * step
            value, gradient, curve = new
    return x


def _merit(hessian: Array, slope: Array, x: Array, n: int, mu: float) -> tuple[float, Array, Array]:
    """Return the barrier function, its gradient and its Hessian; infinite outside."""
    shapes = np.tensordot(x[: 10 * n].reshape(n, 10), _UNITS, axes=1)
    friction = x[10 * n : -n]
    values, vectors = np.linalg.eigh(shapes)
    if values.min() <= 0 or friction.min() <= 0:
        return np.inf, slope, hessian
    along = hessian @ x
    value = float(x @ along) / 2 - float(slope @ x)
    value -= mu * float(np.log(values).sum() + np.log(friction).sum())
    gradient, curve = along - slope, hessian.copy()
    inverse = (vectors / values[:, None]) @ vectors.transpose(0, 2, 1)
    turned = inverse[:, None] @ _UNITS  # (n, 10, 4, 4)
    gradient[: 10 * n] -= mu * np.trace(turned, axis1=2, axis2=3).ravel()
    each = np.einsum("nkab,nlba->nkl", turned, turned)
    for i in range(n):
        part = slice(10 * i, 10 * i + 10)
        curve[part, part] += mu * each[i]
    rest = np.arange(10 * n, len(x) - n)
    gradient[rest] -= mu / friction
    curve[rest, rest] += mu / friction**2
    return value, gradient, curve
