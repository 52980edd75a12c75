"""What inertia an arm shows at its end effector, and the damping and projector made from it.

Stacks of M poses; every product and decomposition is one small LAPACK or BLAS call per matrix, so
that a pose's result is the same bits in any stack.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class OperationalSpace:
    """Operational-space inertia Λ = (J M⁻¹ Jᵀ)⁻¹ of M poses, damped where they are singular.

    With A = S J M⁻¹ Jᵀ S, S = diag(1, 1, 1, ℓ, ℓ, ℓ), every eigenvalue s of A below s_0 is raised
    to (s² + s_0²)/(2 s_0): untouched above s_0, smooth at it, never below s_0/2. So Λ ≤ 2 S²/s_0.
    """

    inertia: Array
    """Λ, (M, 6, 6) [kg, kg·m, kg·m²]."""
    singular: NDArray[np.bool_]
    """(M,) some eigenvalue was raised."""
    minv_jt: Array
    """M⁻¹ Jᵀ, (M, n, 6)."""
    root: Array
    """R, (M, 6, 6), with Rᵀ R = Λ⁻¹ (damped); its rows are the modes of A."""
    inverse_root: Array
    """R⁻ᵀ, (M, 6, 6), with (R⁻ᵀ)ᵀ R⁻ᵀ = Λ."""
    modes: Array
    """Orthogonal eigenvectors of A in rows, (M, 6, 6)."""


def operational_space(
    jacobian: Array, mass: Array, *, singular_below: float, singular_length: float
) -> OperationalSpace:
    """Return the operational space of M poses.

    Args:
        jacobian: (M, 6, n), translation, then rotation.
        mass: (M, n, n) joint-space inertia [kg·m²].
        singular_below: s_0 [1/kg].
        singular_length: ℓ [m].

    Raises:
        StictionError: an entry that is not finite, or a mass that cannot be inverted; it names
            the row.
    """
    jac_t = jacobian.transpose(0, 2, 1)
    scale = np.repeat([1.0, singular_length], 3)
    try:
        minv_jt = np.ascontiguousarray(np.linalg.solve(mass, jac_t))
    except np.linalg.LinAlgError:
        row = int(np.argmax(np.linalg.matrix_rank(mass) < mass.shape[-1]))
        raise StictionError(f"row {row}: mass is singular: allowed is positive definite") from None
    scaled = np.matmul(jacobian, minv_jt) * (scale[:, None] * scale)
    finite = np.isfinite(scaled)
    if not finite.all():
        row = int(np.argwhere(~finite)[0][0])
        raise StictionError(f"row {row}: Jacobian or mass: allowed are finite numbers")
    s, axes = np.linalg.eigh(scaled)
    s0 = singular_below
    root = np.sqrt(np.where(s < s0, (s * s + s0 * s0) / (2.0 * s0), s))[:, :, None]
    modes = np.ascontiguousarray(axes.transpose(0, 2, 1))
    inverse_root = modes * scale / root
    return OperationalSpace(
        inertia=np.matmul(inverse_root.transpose(0, 2, 1), inverse_root),
        singular=s[:, 0] < s0,
        minv_jt=minv_jt,
        root=modes / scale * root,
        inverse_root=inverse_root,
        modes=modes,
    )


def dynamic_projector(jacobian: Array, space: OperationalSpace) -> Array:
    """P = I − Jᵀ Λ J M⁻¹, (M, n, n), thesis eq. 2.17, of Jacobians (M, 6, n).

    Where the pose is not singular P² = P and J M⁻¹ P = 0: its torques do not accelerate the end
    effector.
    """
    inverse = np.matmul(space.inertia, space.minv_jt.transpose(0, 2, 1))
    return np.eye(jacobian.shape[2]) - np.matmul(jacobian.transpose(0, 2, 1), inverse)


def pseudoinverse_projector(jacobian: Array, damping: float) -> Array:
    """P = I − Jᵀ (Jᵀ)^#, (M, n, n), of Jacobians (M, 6, n); physics.md 6.1.

    (Jᵀ)^# has the singular values σ/(σ² + λ²), λ = ``damping``: it is (J Jᵀ + λ²)⁻¹ J.
    """
    jac_t = jacobian.transpose(0, 2, 1)
    damped = np.matmul(jacobian, jac_t) + damping**2 * np.eye(6)
    return np.eye(jacobian.shape[2]) - np.matmul(jac_t, np.linalg.solve(damped, jacobian))


def mass_damping(
    stiffness: Array, ratio: Array, root: Array, inverse_root: Array, modes: Array
) -> Array:
    """Damping D (M, 6, 6) of thesis eq. 2.14.

    K = Qᵀ λ Q and Λ = Qᵀ Q give D = 2 Qᵀ D_ξ √λ Q: each mode decays with its own ξ. Different ξ
    belong to axes here, not to modes. In mode coordinates they are D_ξ = Wᵀ diag(ξ) W with an
    orthogonal W, and D = 2 Qᵀ λ^¼ D_ξ λ^¼ Q. That is eq. 2.14 where all ξ are equal or the modes
    lie along the axes; it is symmetric, never negative, and does not jump when modes swap places.

    Args:
        stiffness: K, (M, 6, 6), positive semidefinite.
        ratio: ξ, (6,) [-].
        root: of :class:`OperationalSpace`, as the next two.
        inverse_root: R⁻ᵀ.
        modes: eigenvectors in rows.
    """
    whitened = np.matmul(np.matmul(root, stiffness), root.transpose(0, 2, 1))
    eigenvalues, vectors = np.linalg.eigh(whitened)
    quarter = np.sqrt(np.sqrt(np.maximum(eigenvalues, 0.0)))[:, :, None]
    half = np.matmul(vectors.transpose(0, 2, 1), inverse_root)  # Q
    half *= quarter
    if np.all(ratio == ratio[0]):
        half *= np.sqrt(2.0 * ratio[0])
    else:
        w = np.matmul(modes.transpose(0, 2, 1), vectors)
        half = np.matmul(w, half) * np.sqrt(2.0 * ratio)[:, None]
    return np.matmul(half.transpose(0, 2, 1), half)
