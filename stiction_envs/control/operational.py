"""Operational-space inertia at an arm's end effector, and the nullspace projector from it.

Operational-space inertia Λ = (J M⁻¹ Jᵀ)⁻¹, damped where a pose is singular: with
A = S J M⁻¹ Jᵀ S, S = diag(1, 1, 1, ℓ, ℓ, ℓ), every eigenvalue s of A below s_0 is raised to
(s² + s_0²)/(2 s_0): untouched above s_0, smooth at it, never below s_0/2. So Λ ≤ 2 S²/s_0.

Functions are compiled and take one pose.
"""

import numpy as np

from stiction_envs.arrays import Array, Bools
from stiction_envs.compiled import compiled


@compiled
def renew(
    jacobian: Array,
    mass: Array,
    projects: bool,
    singular_below: float,
    singular_length: float,
    singular: Bools,
    inertia: Array,
    projector: Array,
) -> bool:
    """Write the operational space of a pose; return False, and write nothing, for a bad mass.

    Args:
        jacobian: (6, n), translation, then rotation.
        mass: (n, n) joint-space inertia [kg·m²]; bad is one not positive definite or not finite.
        projects: whether Λ and P are written; otherwise only whether the pose is singular.
        singular_below: s_0 [1/kg].
        singular_length: ℓ [m].
        singular: (1,) written: some eigenvalue of A is below s_0.
        inertia: (6, 6) written: Λ [kg, kg·m, kg·m²].
        projector: (n, n) written: P = I − Jᵀ Λ J M⁻¹, thesis eq. 2.17. Where the pose is not
            singular P² = P and J M⁻¹ P = 0: its torques do not accelerate the end effector.
    """
    scale = np.ones(6)
    scale[3:] = singular_length
    minv_jt, scaled = _mobility(jacobian, mass, scale)
    if not np.isfinite(scaled.sum()):
        return False
    # all eigenvalues exceed s_0 where A − s_0·I has a factor
    singular[0] = not _factor(scaled, singular_below, np.empty((6, 6)))
    if projects:
        _invert(scaled, scale, singular_below, inertia)
        _project(jacobian, inertia, minv_jt, projector)
    return True


@compiled
def _factor(matrix: Array, shift: float, out: Array) -> bool:
    """Write the Cholesky factor L of A − shift·I; return False if it is not positive definite."""
    for j in range(len(matrix)):
        for m in range(j + 1):
            total = matrix[j, m] - (shift if j == m else 0.0)
            for k in range(m):
                total -= out[j, k] * out[m, k]
            if m < j:
                out[j, m] = total / out[m, m]
            elif total > 0.0:
                out[j, j] = np.sqrt(total)
            else:
                return False
    return True


@compiled
def _invert(scaled: Array, scale: Array, least: float, out: Array) -> None:
    """Write Λ = S A⁻¹ S (6, 6), eigenvalues of A below ``least`` raised."""
    values, vectors = np.linalg.eigh(scaled)
    for k in range(6):
        if values[k] < least:
            values[k] = (values[k] ** 2 + least**2) / (2.0 * least)
    for j in range(6):
        for m in range(6):
            total = 0.0
            for k in range(6):
                total += vectors[j, k] * vectors[m, k] / values[k]
            out[j, m] = scale[j] * total * scale[m]


@compiled
def _mobility(jacobian: Array, mass: Array, scale: Array) -> tuple[Array, Array]:
    """Return M⁻¹ Jᵀ (n, 6), A = S J M⁻¹ Jᵀ S (6, 6); A is NaN for a mass not positive definite."""
    n = len(mass)
    x, scaled = np.empty((n, 6)), np.full((6, 6), np.nan)
    x[:] = jacobian.T
    factor = np.empty((n, n))  # L of M = L Lᵀ
    if not _factor(mass, 0.0, factor):
        return x, scaled
    for j in range(n):  # L x = Jᵀ
        for m in range(j):
            for k in range(6):
                x[j, k] -= factor[j, m] * x[m, k]
        for k in range(6):
            x[j, k] /= factor[j, j]
    for k in range(6):  # J M⁻¹ Jᵀ = (L⁻¹ Jᵀ)ᵀ (L⁻¹ Jᵀ), symmetric to the bit
        for m in range(k + 1):
            total = 0.0
            for j in range(n):
                total += x[j, k] * x[j, m]
            scaled[k, m] = scaled[m, k] = scale[k] * total * scale[m]
    for j in range(n - 1, -1, -1):
        for m in range(j + 1, n):
            for k in range(6):
                x[j, k] -= factor[m, j] * x[m, k]
        for k in range(6):
            x[j, k] /= factor[j, j]
    return x, scaled


@compiled
def _project(jacobian: Array, inertia: Array, minv_jt: Array, out: Array) -> None:
    """Write I − Jᵀ Λ J M⁻¹ (n, n) of one pose."""
    n = len(out)
    inverse = np.empty((n, 6))  # (Λ J M⁻¹)ᵀ
    for j in range(n):
        for k in range(6):
            total = 0.0
            for m in range(6):
                total += inertia[k, m] * minv_jt[j, m]
            inverse[j, k] = total
    for j in range(n):
        for m in range(n):
            total = 1.0 if j == m else 0.0
            for k in range(6):
                total -= jacobian[k, j] * inverse[m, k]
            out[j, m] = total
