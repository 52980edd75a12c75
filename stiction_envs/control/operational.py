"""Operational-space inertia at an arm's end effector, and damping and nullspace projector from it.

Operational-space inertia Λ = (J M⁻¹ Jᵀ)⁻¹, damped where a pose is singular: with
A = S J M⁻¹ Jᵀ S, S = diag(1, 1, 1, ℓ, ℓ, ℓ), every eigenvalue s of A below s_0 is raised to
(s² + s_0²)/(2 s_0): untouched above s_0, smooth at it, never below s_0/2. So Λ ≤ 2 S²/s_0.

Functions take stacks of M poses and are compiled. Poses are computed one after the other in plain
arithmetic, so that a pose's result is the same bits in any stack.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stiction_envs.compiled import Arguments, compiled
from stiction_envs.control.eigen import eigen

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Index = NDArray[np.int64]


@compiled
def renew(
    rows: Index,
    jacobian: Array,
    mass: Array,
    singular_below: float,
    singular_length: float,
    singular: Bools,
    inertia: Array,
    root: Array,
    inverse_root: Array,
    modes: Array,
    projector: Array,
) -> int:
    """Write the operational space of M poses to rows of arrays of all N.

    Args:
        rows: (M,) where to write.
        jacobian: (M, 6, n), translation, then rotation.
        mass: (M, n, n) joint-space inertia [kg·m²].
        singular_below: s_0 [1/kg].
        singular_length: ℓ [m].
        singular: (N,) written: some eigenvalue was raised.
        inertia: (N, 6, 6) written: Λ [kg, kg·m, kg·m²].
        root: (N, 6, 6) written: R with Rᵀ R = Λ⁻¹ (damped); its rows are the modes of A.
        inverse_root: (N, 6, 6) written: R⁻ᵀ, with (R⁻ᵀ)ᵀ R⁻ᵀ = Λ.
        modes: (N, 6, 6) written: eigenvectors of A in rows, in no order.
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
        total = 0.0
        for k in range(6):
            for m in range(6):
                total += scaled[i, k, m]
        if not np.isfinite(total):
            return i
    s, axes = eigen(scaled)
    s0 = singular_below
    for i in range(len(rows)):
        row = rows[i]
        singular[row] = False
        for k in range(6):
            x = s[i, k]
            if x < s0:
                singular[row] = True
                x = (x * x + s0 * s0) / (2.0 * s0)
            x = np.sqrt(x)
            for m in range(6):
                modes[row, k, m] = axes[i, k, m]
                root[row, k, m] = axes[i, k, m] / scale[m] * x
                inverse_root[row, k, m] = axes[i, k, m] * scale[m] / x
        _square(inverse_root[row], inertia[row])
        _project(jacobian[i], inertia[row], minv_jt[i], projector[row])
    return -1


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


# products of 6 × 6 matrices: with a constant size the compiled code takes a third of the time


@compiled
def _square(half: Array, out: Array) -> None:
    """Write HᵀH of H, both (6, 6)."""
    for k in range(6):
        for m in range(6):
            total = 0.0
            for j in range(6):
                total += half[j, k] * half[j, m]
            out[k, m] = total


@compiled
def _product(a: Array, b: Array, out: Array) -> None:
    """Write A B, all (6, 6)."""
    for k in range(6):
        for m in range(6):
            total = 0.0
            for j in range(6):
                total += a[k, j] * b[j, m]
            out[k, m] = total


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


@compiled
def damp_by_mass(
    rows: Index,
    stiffness: Array,
    ratio: Array,
    root: Array,
    inverse_root: Array,
    modes: Array,
    damping: Array,
) -> None:
    """Write minus the damping D of thesis eq. 2.14 to rows of arrays of all N.

    K = Qᵀ λ Q and Λ = Qᵀ Q give D = 2 Qᵀ D_ξ √λ Q: each mode decays with its own ξ. Different ξ
    belong to axes here, not to modes. In mode coordinates they are D_ξ = Wᵀ diag(ξ) W with an
    orthogonal W, and D = 2 Qᵀ λ^¼ D_ξ λ^¼ Q. That is eq. 2.14 where all ξ are equal or the modes
    lie along the axes; it is symmetric, never negative, and does not jump when modes swap places.

    Args:
        rows: (M,) rows to write.
        stiffness: K, (N, 6, 6), positive semidefinite.
        ratio: ξ, (6,) [-].
        root: of `renew`, as the next two; zero before it was called, and so is D.
        inverse_root: R⁻ᵀ.
        modes: eigenvectors in rows.
        damping: (N, 6, 6) written: −D.
    """
    whitened, left = np.empty((len(rows), 6, 6)), np.empty((6, 6))
    for i in range(len(rows)):
        r = root[rows[i]]
        _product(r, stiffness[rows[i]], left)
        for k in range(6):
            for m in range(6):
                total = 0.0
                for j in range(6):
                    total += left[k, j] * r[m, j]
                whitened[i, k, m] = total
    eigenvalues, vectors = eigen(whitened)
    half, turned, w = np.empty((6, 6)), np.empty((6, 6)), np.empty((6, 6))
    equal_ratios = True
    for k in range(6):
        equal_ratios &= ratio[k] == ratio[0]
    for i in range(len(rows)):
        row = rows[i]
        _product(vectors[i], inverse_root[row], half)  # Q
        for k in range(6):
            scale = np.sqrt(np.sqrt(max(eigenvalues[i, k], 0.0)))
            if equal_ratios:
                scale *= np.sqrt(2.0 * ratio[0])
            for m in range(6):
                half[k, m] *= scale
        if not equal_ratios:
            _product(modes[row].T, vectors[i].T, w)
            _product(w, half, turned)
            for k in range(6):
                for m in range(6):
                    half[k, m] = turned[k, m] * np.sqrt(2.0 * ratio[k])
        _square(half, left)
        for k in range(6):
            for m in range(6):
                damping[row, k, m] = -left[k, m]


class SpaceArrays(NamedTuple):
    """What `renew_all` needs besides Jacobians and inertias of N arms."""

    space: Arguments
    """Of `renew` behind the inertias."""
    damped_by_mass: bool
    """Whether damping depends on the inertias."""
    damping: Arguments
    """Of `damp_by_mass` behind the rows."""


@compiled
def renew_all(jacobian: Array, mass: Array, arguments: Arguments) -> None:
    """Write the operational space of all N arms, and the damping that depends on it.

    Where an arm has none, `renew` writes nothing: all keep their last.
    """
    a, rows = SpaceArrays(*arguments), np.arange(len(mass))
    if renew(rows, jacobian, mass, *a.space) < 0 and a.damped_by_mass:
        damp_by_mass(rows, *a.damping)
