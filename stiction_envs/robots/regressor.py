"""Inverse dynamics as a linear map of link parameters, and the parameters that torques can show.

τ = W(q, q̇, q̈) φ with ten numbers per link, φ = (m, m c, I) about the joint's origin in the link's
axes (C. Atkeson, C. An, J. Hollerbach, "Estimation of inertial parameters of manipulator loads and
links", 1986). W has not full rank: only sums of parameters act on the torques, the base parameters
(M. Gautier, "Numerical calculation of the base inertial parameters of robots", 1991).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.linalg import qr, solve_triangular

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.robots import Arm

PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Parameters of one link in pinocchio's order: mass [kg], first moment [kg·m], inertia [kg·m²]."""
RANK = 1e-8  # singular values, over the largest, that count as zero [-] (assumed)
_LAST = {"m": 1e-3, "mz": 1e-2, "Iyy": 1e-1}
"""Weights by which the pivoting avoids parameters [-] (assumed). Of joints that turn about z these
parameters can be grouped into others (M. Gautier, W. Khalil, "Direct calculation of minimum set of
inertial parameters of serial robots", 1990), which keeps the sums short."""
LEAST = 1e-6  # coefficients of a grouping that count as zero [-] (assumed)
SPEED_UP_TIME = 0.3  # time in which a joint usually comes to its speed limit [s]; assumed
STATES_PER_JOINT = 40
"""Random states, over all of the range, from which the base parameters are found; assumed."""


def inertial_names(n: int) -> tuple[str, ...]:
    """Return the names of the 10 n link parameters: ``m1``, ``mx1``, …, ``Izz7``."""
    return tuple(f"{name}{link}" for link in range(1, n + 1) for name in PARAMETERS)


def inertial_parameters(model: pin.Model) -> Array:
    """Return (n, 10) parameters of the links, with all bodies fixed to them."""
    return np.array([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])


def torque_regressor(model: pin.Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Return (T, n, 10 n): W with W @ φ = τ [N·m], along q, dq, ddq (T, n) [rad, s]."""
    data = model.createData()
    out = np.empty((len(q), model.nv, 10 * model.nv))
    for k in range(len(q)):
        out[k] = pin.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])
    return out


def pseudo_inertia(phi: ArrayLike) -> Array:
    """Return (..., 4, 4) pseudo-inertia J = ∫ρ (x, 1)(x, 1)ᵀ dV of parameters (..., 10).

    A body with mass somewhere exists if and only if J is positive definite (P. Wensing, S. Kim,
    J.-J. Slotine, "Linear matrix inequalities for physically consistent inertial parameter
    identification", IEEE RA-L 2018).
    """
    p = np.asarray(phi, dtype=np.float64)
    bodies = [pin.PseudoInertia.FromDynamicParameters(x).toMatrix() for x in p.reshape(-1, 10)]
    return np.array(bodies).reshape(*p.shape[:-1], 4, 4)


def from_pseudo_inertia(j: ArrayLike) -> Array:
    """Return parameters (..., 10) of pseudo-inertias (..., 4, 4)."""
    a = np.asarray(j, dtype=np.float64)
    bodies = [pin.PseudoInertia.FromMatrix(x).toDynamicParameters() for x in a.reshape(-1, 4, 4)]
    return np.array(bodies).reshape(*a.shape[:-2], 10)


def consistent(phi: ArrayLike) -> Bools:
    """Return (...,) whether bodies of parameters (..., 10) can exist."""
    return np.asarray(np.linalg.eigvalsh(pseudo_inertia(phi))[..., 0] > 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class BaseSet:
    """Base parameters β = φ[kept] + K φ[dropped]: the sums of p parameters that torques show."""

    names: tuple[str, ...]
    """(p,) of all parameters."""
    kept: Index
    """(r,) parameters whose columns are independent, in order."""
    dropped: Index
    """(p − r,) parameters whose columns are sums of the kept ones, or zero."""
    grouping: Array
    """(r, p − r) K."""

    @property
    def size(self) -> int:
        """Number r of base parameters."""
        return len(self.kept)

    def values(self, phi: ArrayLike) -> Array:
        """Return (..., r) base parameters of all parameters (..., p)."""
        x = np.asarray(phi, dtype=np.float64)
        return np.asarray(x[..., self.kept] + x[..., self.dropped] @ self.grouping.T)

    def expressions(self) -> tuple[str, ...]:
        """Return the sums as text: ``Izz1 + Iyy2 - 0.316 my2``."""
        dropped = [self.names[d] for d in self.dropped]
        return tuple(
            self.names[k] + "".join(_term(c, d) for c, d in zip(row, dropped, strict=True))
            for k, row in zip(self.kept, self.grouping.tolist(), strict=True)
        )


def _term(coefficient: float, name: str) -> str:
    if coefficient == 0:
        return ""
    size = abs(coefficient)
    factor = "" if abs(size - 1) < LEAST else f"{size:.4g} "
    return f" {'+' if coefficient > 0 else '-'} {factor}{name}"


def base_set(columns: Array, names: Sequence[str]) -> BaseSet:
    """Return the base parameters of a regressor, by QR with column pivoting.

    ``columns`` (R, p) are those of exciting motions, the rows of all joints below one another.
    """
    size = np.linalg.norm(columns, axis=0)
    acts = np.flatnonzero(size > RANK * size.max())
    triangle = np.linalg.qr(columns[:, acts] / size[acts], mode="r")
    _, values, vectors = np.linalg.svd(triangle, full_matrices=False)
    rank = int((values > RANK * values[0]).sum())
    # sums depend on the row space alone; pivots of its orthonormal basis keep K small
    rows = np.linalg.qr((vectors[:rank] * size[acts]).T)[0].T
    preference = np.array([_LAST.get(names[i].rstrip("0123456789"), 1.0) for i in acts.tolist()])
    r, order = qr(rows * preference, mode="r", pivoting=True)
    first, later = acts[order[:rank]], acts[order[rank:]]
    mix = solve_triangular(r[:rank, :rank], r[:rank, rank:])
    mix = mix * preference[order[:rank], None] / preference[order[rank:]]
    mix[np.abs(mix) < LEAST] = 0.0
    sort = np.argsort(first)
    dropped = np.setdiff1d(np.arange(len(names)), first)
    grouping = np.zeros((rank, len(dropped)))
    grouping[:, np.searchsorted(dropped, later)] = mix[sort]
    return BaseSet(names=tuple(names), kept=first[sort], dropped=dropped, grouping=grouping)


def columns_of(model: pin.Model, q: Array, dq: Array, ddq: Array, own: Array) -> Array:
    """Return (T, n, 10 n + k n) torque per parameter: ten per link, then k per joint.

    q, dq, ddq are (T, n) [rad, s]; ``own`` (T, n, k) is torque per parameter of a joint's own:
    rotor, friction, offset.
    """
    joints = np.einsum("tjk,ji->tjki", own, np.eye(own.shape[1]))
    links = torque_regressor(model, q, dq, ddq)
    return np.concatenate([links, joints.reshape(*own.shape[:2], -1)], axis=2)


def structural_base(arm: Arm, kinds: tuple[str, ...]) -> tuple[BaseSet, Array]:
    """Return the base parameters that some motion excites, and (r,) the torque of one unit of each.

    The torque is over its joint's limit, root mean square over states all over the range; ``kinds``
    are parameters of each joint, a part of "rotor", "Fc", "Fv", "offset".
    """
    n, limits = arm.n, arm.limits
    rows = STATES_PER_JOINT * n
    rng = np.random.default_rng(0)
    low, high = limits.position.T
    q = rng.uniform(low, high, (rows, n))
    dq = rng.uniform(-1, 1, (rows, n)) * limits.velocity
    ddq = rng.uniform(-1, 1, (rows, n)) * limits.velocity / SPEED_UP_TIME
    own = {"rotor": ddq, "Fc": np.sign(dq), "Fv": dq, "offset": np.ones_like(q)}
    whole = columns_of(arm.pinocchio(), q, dq, ddq, np.stack([own[k] for k in kinds], axis=2))
    names = (*inertial_names(n), *(f"{kind}{j}" for kind in kinds for j in range(1, n + 1)))
    base = base_set(whole.reshape(-1, len(names)), names)
    kept = whole[:, :, base.kept] / limits.torque[:, None]
    return base, np.sqrt(np.square(kept).mean(axis=0).max(axis=0))
