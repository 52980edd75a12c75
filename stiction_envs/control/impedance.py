"""Cartesian impedance control of N arms in lockstep: thesis 2.5, equations 2.9 to 2.17.

    τ = sat( Jᵀ(−K e − D J q̇) + P τ_0 + dither ),   τ_0 = k_n (q_d − q) − d_n q̇

without gravity, which the robot adds, and without the reference velocity in the damping, as in the
package that the thesis used (Mayr & Salt-Ducaju; sources.md 6.1). Simulations are independent of
each other: results are the same bits for any N.

Passive are the Cartesian part alone (k_n = 0, equal stiffness about the three axes of rotation) and
motion within the nullspace. Together they are not: P stops the nullspace spring from taking back
what Cartesian motion stored in it, a known property of the projection approach (Ott 2008).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled, inlined
from stiction_envs.control.operational import renew
from stiction_envs.control.rotation import error_matrix
from stiction_envs.errors import checked_array
from stiction_envs.method_settings import Amount, FinitePositive, Positive, check_fields
from stiction_envs.robots import Limits
from stiction_envs.robots.arm_toml import Table, read_toml

GTE_DEFAULTS: dict[str, Table] = {
    table: {name: entry["value"] for name, entry in entries.items()}
    for table, entries in read_toml(Path(__file__).with_name("gte.toml")).items()
}
"""Values of ``gte.toml``, which has their sources, by table and name."""
_DEFAULT = GTE_DEFAULTS["impedance"]
Stiffness = Amount | Annotated[tuple[Amount, ...], msgspec.Meta(min_length=3, max_length=3)]
"""One number for all axes, or one for each of three."""
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]
Ratios = Ratio | Annotated[tuple[Ratio, ...], msgspec.Meta(min_length=6, max_length=6)]


@dataclass(frozen=True, kw_only=True)
class ImpedanceSettings:
    """Constant settings of the controller; defaults and their sources are in ``gte.toml``."""

    translational_stiffness: Stiffness = _DEFAULT["translational_stiffness"]
    """K_t, one number or (3,) in the base frame [N/m]."""
    rotational_stiffness: Stiffness = _DEFAULT["rotational_stiffness"]
    """K_r, one number or (3,) about the base frame's axes [N·m/rad]."""
    nullspace_stiffness: Amount | tuple[Amount, ...] = _DEFAULT["nullspace_stiffness"]
    """k_n, one number or (n,) [N·m/rad]; 0 means no nullspace torque."""
    damping_ratio: Ratios = _DEFAULT["damping_ratio"]
    """ξ, one number or (6,), in [0, 1] [-]."""
    nullspace_damping_ratio: Ratio = _DEFAULT["nullspace_damping_ratio"]
    """ξ_n of d_n = 2 ξ_n √k_n, in [0, 1] [-]. It contains no mass: critical in number only."""
    pseudoinverse_damping: FinitePositive = _DEFAULT["pseudoinverse_damping"]
    """λ of the J^# of a feedforward compensation, singular values σ/(σ² + λ²) [m and rad]."""
    torque_rate: Positive = _DEFAULT["torque_rate"]
    """Largest change of a joint's command per cycle [N·m]; inf is off."""
    singular_below: FinitePositive = _DEFAULT["singular_below"]
    """Smallest eigenvalue of the scaled J M⁻¹ Jᵀ that is still regular, s_0 [1/kg]."""
    singular_length: FinitePositive = _DEFAULT["singular_length"]
    """ℓ: a rotation of 1 rad counts as this translation there [m]."""
    limit_margin: Amount = _DEFAULT["limit_margin"]
    """Distance from a joint limit that counts as near [rad]."""

    def __post_init__(self) -> None:
        check_fields(self, "impedance")


_TINY = np.finfo(np.float64).tiny


class Impedance(NamedTuple):
    """Settings and state of N controllers of n joints."""

    rate: float  # Largest change of the torque per cycle [N·m]
    limit: Array  # (n,) largest torque [N·m]
    low: Array  # (n,) angle below which a joint is near its limit [rad]
    high: Array  # (n,) angle above which a joint is near its limit [rad]
    singular_below: float  # s_0 of `operational.renew` [1/kg]
    singular_length: float  # ℓ of `operational.renew` [m]
    position: Array  # (N, 3) of the reference [m]
    quaternion: Array  # (N, 4) of the reference
    error_matrix: Array  # (N, 4, 4) `rotation.error_matrix` of the reference
    gain: Array  # (N, 6, 12) wrench per state: [−K, −D]
    null_active: Bools  # (N,) whether there is a nullspace torque, of the next four
    null_q: Array  # (N, n) q_d [rad]
    null_stiffness: Array  # (N, n) k_n [N·m/rad]
    null_damping: Array  # (N, n) d_n [N·m·s/rad]
    null_torque: Array  # (N, n) τ_0 of the last cycle, written [N·m]
    projector: Array  # (N, n, n) P [-]
    inertia: Array  # (N, 6, 6) Λ [kg, kg·m, kg·m²]
    singular: Bools  # (N,) whether the pose was (nearly) singular at the last `renew_space`
    state: Array  # (N, 12) error [m, rad], then J q̇ [m/s, rad/s], of the last cycle
    q: Array  # (N, n) angles in the last cycle [rad]
    wanted: Array  # (N, n) torque of the last cycle before the saturation [N·m]
    command: Array  # (N, n) torque of the last cycle behind the saturation [N·m]


class CartesianImpedance:
    """N arms of n joints under Cartesian impedance control; `impedance_cycle` is called per cycle.

    Λ and P, the slow part, are held for some 10 to 20 cycles. In singular poses they are bounded
    (`operational`). Finite arguments give finite torques; NaN passes through.
    """

    def __init__(self, settings: ImpedanceSettings, nsim: int, limits: Limits) -> None:
        """Make the controllers of ``nsim`` arms with limits (n,); each needs `reset` at first.

        Raise a StictionError for a nullspace stiffness that is not one number or (n,).
        """
        n = len(limits.torque)
        self.settings, self.nsim, self.n = settings, nsim, n
        s = settings
        still = np.tile([1.0, 0.0, 0.0, 0.0], (nsim, 1))
        self.arrays = a = Impedance(
            rate=s.torque_rate,
            limit=np.array(limits.torque),
            low=limits.position[:, 0] + s.limit_margin,
            high=limits.position[:, 1] - s.limit_margin,
            singular_below=s.singular_below,
            singular_length=s.singular_length,
            position=np.zeros((nsim, 3)),
            quaternion=still,
            error_matrix=error_matrix(still),
            gain=np.zeros((nsim, 6, 12)),
            null_active=np.zeros(nsim, dtype=bool),
            null_q=np.zeros((nsim, n)),
            null_stiffness=np.zeros((nsim, n)),
            null_damping=np.zeros((nsim, n)),
            null_torque=np.zeros((nsim, n)),
            projector=np.zeros((nsim, n, n)),
            inertia=np.zeros((nsim, 6, 6)),
            singular=np.zeros(nsim, dtype=bool),
            state=np.zeros((nsim, 12)),
            q=np.zeros((nsim, n)),
            wanted=np.zeros((nsim, n)),
            command=np.zeros((nsim, n)),
        )
        """Arrays that compiled functions read and write; always the same objects."""
        self.wanted, self.command = a.wanted, a.command
        """(N, n) torque of the last cycle before and behind the saturation, overwritten [N·m]."""
        self._ratio = np.array(np.broadcast_to(s.damping_ratio, 6), dtype=float)
        nullspace = checked_array(s.nullspace_stiffness, "nullspace stiffness", (n,), fill=True)
        everyone = np.arange(nsim)
        self.set_stiffness(everyone, s.translational_stiffness, s.rotational_stiffness, nullspace)

    def reset(self, ids: Index, position: ArrayLike, quaternion: ArrayLike, q: ArrayLike) -> None:
        """Start arms ``ids`` (M,) anew: reference and nullspace at their poses, no torque.

        The end effector's position (M, 3) [m] and quaternion (M, 4) are in the base frame; the
        joint angles q are (M, n) [rad].
        """
        a = self.arrays
        a.position[ids], a.quaternion[ids] = position, quaternion
        a.error_matrix[ids] = error_matrix(a.quaternion[ids])
        a.null_q[ids] = a.q[ids] = q
        a.wanted[ids] = a.command[ids] = 0.0

    def set_stiffness(
        self, ids: Index, translational: ArrayLike, rotational: ArrayLike, nullspace: ArrayLike
    ) -> None:
        """Change the stiffness of arms ``ids`` (M,), and the damping with it; stiffnesses are ≥ 0.

        They broadcast to (M, 3) [N/m], (M, 3) [N·m/rad] and (M, n) [N·m/rad].
        """
        a, diagonal = self.arrays, np.empty((len(ids), 6))
        diagonal[:, :3], diagonal[:, 3:] = translational, rotational
        a.gain[ids, :, :6] = -diagonal[:, :, None] * np.eye(6)
        a.gain[ids, :, 6:] = -(2.0 * self._ratio * np.sqrt(diagonal))[:, :, None] * np.eye(6)
        a.null_stiffness[ids] = nullspace
        ratio = self.settings.nullspace_damping_ratio
        a.null_damping[ids] = 2.0 * ratio * np.sqrt(a.null_stiffness[ids])
        a.null_active[ids] = a.null_stiffness[ids].any(axis=1)


@compiled
def renew_space(i: int, jacobian: Array, mass: Array, a: Impedance) -> bool:
    """Renew Λ and P of arm ``i`` where a nullspace torque needs them, and whether it is singular.

    See `operational.renew`.
    """
    low = a.singular_below, a.singular_length
    singular = a.singular[i : i + 1]
    return renew(jacobian, mass, a.null_active[i], *low, singular, a.inertia[i], a.projector[i])


@inlined
def impedance_cycle(
    i: int,
    position: Array,
    quaternion: Array,
    jacobian: Array,
    q: Array,
    dq: Array,
    added: Array,
    a: Impedance,
) -> None:
    """Write the command of arm ``i``.

    Measured are position (N, 3) [m], quaternion (N, 4), Jacobian (N, 6, n), q and dq (N, n) [rad,
    rad/s]; ``added`` (N, n) is dither and compensation, added to the torque [N·m].
    """
    n = dq.shape[1]
    state, wanted = a.state, a.wanted
    pose_error(position[i], quaternion[i], a.position[i], a.error_matrix[i], state[i])
    for k in range(6):
        speed = 0.0
        for j in range(n):
            speed += jacobian[i, k, j] * dq[i, j]
        state[i, 6 + k] = speed
    for j in range(n):
        a.q[i, j] = q[i, j]
        wanted[i, j] = 0.0
    for k in range(6):  # joints side by side in memory
        wrench = 0.0
        for m in range(12):
            wrench += a.gain[i, k, m] * state[i, m]
        for j in range(n):
            wanted[i, j] += jacobian[i, k, j] * wrench
    if a.null_active[i]:  # P (k_n (q_d − q) − d_n q̇)
        for j in range(n):
            spring = a.null_stiffness[i, j] * (a.null_q[i, j] - q[i, j])
            a.null_torque[i, j] = spring - a.null_damping[i, j] * dq[i, j]
        for j in range(n):
            total = 0.0
            for m in range(n):
                total += a.projector[i, j, m] * a.null_torque[i, m]
            wanted[i, j] += total
    for j in range(n):
        wanted[i, j] += added[i, j]
        limit, last = a.limit[j], a.command[i, j]
        low, high = max(last - a.rate, -limit), min(last + a.rate, limit)
        a.command[i, j] = between(wanted[i, j], low, high)


@compiled
def read_flags(i: int, a: Impedance, out: Bools) -> None:
    """Raise flags (3,) of arm ``i``; none is lowered.

    Singular: at the last `renew_space` Λ was damped. Saturated: in the last cycle the torque rate
    or a torque limit cut a joint's command. Near a limit: a joint was within the margin or beyond.
    """
    if a.singular[i]:
        out[0] = True
    for j in range(a.q.shape[1]):
        if a.wanted[i, j] != a.command[i, j] or abs(a.command[i, j]) >= a.limit[j]:
            out[1] = True
        if a.q[i, j] < a.low[j] or a.q[i, j] > a.high[j]:
            out[2] = True


@inlined
def pose_error(
    position: Array, quaternion: Array, reference: Array, error_matrix: Array, error: Array
) -> None:
    """Write the error of one arm into the first six of ``error`` [m, rad].

    Arguments are one arm's rows of those of `impedance_cycle` and `Impedance`.
    """
    for k in range(3):
        error[k] = position[k] - reference[k]
    w = x = y = z = 0.0  # an array would be allocated for every arm
    for m in range(4):
        w += error_matrix[0, m] * quaternion[m]
        x += error_matrix[1, m] * quaternion[m]
        y += error_matrix[2, m] * quaternion[m]
        z += error_matrix[3, m] * quaternion[m]
    # as rotation.rotation_error
    length = np.sqrt(x**2 + y**2 + z**2)
    factor = np.copysign(2.0 * np.arctan2(length, abs(w)) / max(length, _TINY), w)
    error[3], error[4], error[5] = factor * x, factor * y, factor * z


@inlined
def between(x: float, low: float, high: float) -> float:
    """Return x within low and high; NaN stays NaN."""
    if x < low:
        return low
    if x > high:
        return high
    return x
