"""Operational-space inertia at an arm's end effector, and the nullspace projector from it.

Operational-space inertia Λ = (J M⁻¹ Jᵀ)⁻¹, damped where a pose is singular: with
A = S J M⁻¹ Jᵀ S, S = diag(1, 1, 1, ℓ, ℓ, ℓ), every eigenvalue s of A below s_0 is raised to
(s² + s_0²)/(2 s_0): untouched above s_0, smooth at it, never below s_0/2. So Λ ≤ 2 S²/s_0.

Functions take stacks of M poses and are compiled. Poses are computed one after the other, so that
a pose's result is the same bits in any stack.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import compiled

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Index = NDArray[np.int64]


@compiled
def renew(
    rows: Index,
    jacobian: Array,
    mass: Array,
    projects: bool,
    singular_below: float,
    singular_length: float,
    singular: Bools,
    inertia: Array,
    projector: Array,
) -> int:
    """Write the operational space of M poses to rows of arrays of all N.

    Args:
        rows: (M,) where to write.
        jacobian: (M, 6, n), translation, then rotation.
        mass: (M, n, n) joint-space inertia [kg·m²].
        projects: whether Λ and P are written; otherwise only whether the poses are singular.
        singular_below: s_0 [1/kg].
        singular_length: ℓ [m].
        singular: (N,) written: some eigenvalue of A is below s_0.
        inertia: (N, 6, 6) written: Λ [kg, kg·m, kg·m²].
        projector: (N, n, n) written: P = I − Jᵀ Λ J M⁻¹, thesis eq. 2.17. Where the pose is not
            singular P² = P and J M⁻¹ P = 0: its torques do not accelerate the end effector.

    Returns:
        −1, or the first of the M poses that has none, its mass not positive definite or something
        not finite; nothing is written then.
    """
    scale = np.ones(6)
    scale[3:] = singular_length
    minv_jt, scaled = _mobility(jacobian, mass, scale)
    for i in range(len(rows)):
        if not np.isfinite(scaled[i].sum()):
            return i
    for i in range(len(rows)):
        row = rows[i]
        singular[row] = not _exceeds(scaled[i], singular_below)
        if projects:
            _invert(scaled[i], scale, singular_below, inertia[row])
            _project(jacobian[i], inertia[row], minv_jt[i], projector[row])
    return -1


@compiled
def _exceeds(matrix: Array, bound: float) -> bool:
    """Return whether all eigenvalues exceed a bound: A − bound·I has a Cholesky factor."""
    n = len(matrix)
    factor = np.empty((n, n))
    for j in range(n):
        for m in range(j + 1):
            total = matrix[j, m] - (bound if j == m else 0.0)
            for k in range(m):
                total -= factor[j, k] * factor[m, k]
            if m < j:
                factor[j, m] = total / factor[m, m]
            elif total > 0.0:
                factor[j, j] = np.sqrt(total)
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
    """Return M⁻¹ Jᵀ (M, n, 6) and A = S J M⁻¹ Jᵀ S (M, 6, 6).

    NaN where the mass is not positive definite.
    """
    count, n = mass.shape[0], mass.shape[1]
    minv_jt, scaled = np.empty((count, n, 6)), np.empty((count, 6, 6))
    factor = np.empty((n, n))
    for i in range(count):
        x = minv_jt[i]
        for j in range(n):
            for k in range(6):
                x[j, k] = jacobian[i, k, j]
        for j in range(n):  # M = L Lᵀ, and L x = Jᵀ meanwhile
            for m in range(j + 1):
                total = mass[i, j, m]
                for k in range(m):
                    total -= factor[j, k] * factor[m, k]
                if m < j:
                    factor[j, m] = total / factor[m, m]
                else:
                    factor[j, j] = np.sqrt(total) if total > 0.0 else np.nan
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
                scaled[i, k, m] = scaled[i, m, k] = scale[k] * total * scale[m]
        for j in range(n - 1, -1, -1):
            for m in range(j + 1, n):
                for k in range(6):
                    x[j, k] -= factor[m, j] * x[m, k]
            for k in range(6):
                x[j, k] /= factor[j, j]
    return minv_jt, scaled


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
