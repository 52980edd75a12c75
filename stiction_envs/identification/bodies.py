"""Physically consistent links: least squares of torques over positive-definite pseudo-inertias.

A convex program (P. Wensing, S. Kim, J.-J. Slotine, "Linear matrix inequalities for physically
consistent inertial parameter identification", IEEE RA-L 2018), solved by `least_consistent`:

    min ½ ‖R p − z‖² + ½ Σ_i ‖C_i⁻¹ (J_i − J⁰_i) C_i⁻ᵀ‖²/s²  with J_i positive definite, f ≥ 0

with the pseudo-inertias J_i of the links, their nominal values J⁰_i, and friction f. The second
term keeps what torques do not determine near the nominal, in a measure without a frame (T. Lee,
P. Wensing, F. Park, "Geometric robot dynamic identification: a convex programming approach", IEEE
T-RO 2020). Friction is kept under its usual size in the same way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.identification.base_parameters import Design, Fit, correlated_rows, normal_sums
from stiction_envs.identification.settings import IdentificationSettings, identification_settings
from stiction_envs.robots.consistent import TWICE, frames, least_consistent

Array = NDArray[np.float64]
LEAST_FRICTION = 1e-4
"""Friction below this part of its usual size counts as zero [-]; assumed: it is on its bound."""


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
    prior = np.concatenate([np.tile(TWICE, n) / trust**2, np.ones(len(a) - links)])
    slope[:links] += prior[:links] * units.nominal.ravel()
    hessian[np.diag_indices_from(hessian)] += prior
    x = least_consistent(hessian, slope, n, free=n)
    friction = x[links:-n]  # rotor, Coulomb, viscous; the offset is last and may be negative
    friction[friction < LEAST_FRICTION] = 0.0
    return np.asarray(wide @ x)
