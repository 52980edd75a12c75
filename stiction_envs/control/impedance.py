"""Cartesian impedance control of N arms in lockstep: thesis 2.5, equations 2.9 to 2.17.

    τ = sat( Jᵀ(−K e − D J q̇) + P τ_0 + dither ),   τ_0 = k_n (q_d − q) − d_n q̇

without gravity, which the robot adds, and with the reference's own velocity left out of the
damping, as in the package the thesis used (Mayr & Salt-Ducaju; sources.md 6.1). Everything is
computed simulation by simulation: results are the same bits for any N.

Passive are the Cartesian part alone (k_n = 0, equal stiffness about the three axes of rotation) and
motion within the nullspace. Together they are not: P stops the nullspace spring from taking back
what Cartesian motion stored in it, a known property of the projection approach (Ott 2008).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.control.impedance_kernels import (
    Impedance,
    advance_reference,
    impedance_cycle,
    read_flags,
)
from stiction_envs.control.operational import renew
from stiction_envs.control.rotation import error_matrix
from stiction_envs.control.settings import ImpedanceSettings, numbers
from stiction_envs.errors import StictionError
from stiction_envs.robots import Limits

__all__ = ["CartesianImpedance", "Flags", "ImpedanceSettings"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Ids = Index | Sequence[int] | None
"""Simulations a call is about; None means all."""


@dataclass(frozen=True)
class Flags:
    """Warnings of each simulation, (N,) bool."""

    singular: NDArray[np.bool_]
    """At the last `update_model` the arm was (nearly) singular, so that Λ is damped."""
    saturated: NDArray[np.bool_]
    """In the last cycle the torque rate or a torque limit cut the command of some joint."""
    near_limit: NDArray[np.bool_]
    """In the last cycle some joint was beyond, or within the margin of, its position limit."""


class CartesianImpedance:
    """N arms of n joints under Cartesian impedance control; `torque` is called once per cycle.

    `update_model` is the slow part: the caller repeats it every 10 to 20 cycles, and its results
    are held in between. In singular poses Λ and P are bounded (`operational`) and the flag
    `singular` is set. Finite arguments give finite torques; NaN passes through.

    Arguments called ``ids`` are the simulations (M,) to which the other arguments belong; None is
    all of them.
    """

    def __init__(self, settings: ImpedanceSettings, nsim: int, limits: Limits) -> None:
        """Make the controllers; each needs `reset` and `update_model` before `torque`.

        Args:
            settings: of all arms; stiffness can be changed arm by arm with `set_stiffness`.
            nsim: number of arms N ≥ 1.
            limits: of one arm of n joints; its position and torque limits are used.

        Raises:
            StictionError: nsim, or a nullspace stiffness that is not one number or (n,).
        """
        if nsim < 1:
            raise StictionError(f"number of simulations {nsim}: expected 1 or more")
        n = len(limits.torque)
        self.settings, self.nsim, self.n = settings, nsim, n
        s = settings
        still = np.tile([1.0, 0.0, 0.0, 0.0], (nsim, 1))
        self.arrays = a = Impedance(
            dither_after=s.dither_after_saturation,
            rate=s.torque_rate,
            limit=np.array(limits.torque),
            low=limits.position[:, 0] + s.limit_margin,
            high=limits.position[:, 1] - s.limit_margin,
            singular_below=s.singular_below,
            singular_length=s.singular_length,
            filter_step=s.filter_step,
            position_target=np.zeros((nsim, 3)),
            quaternion_target=still.copy(),
            position=np.zeros((nsim, 3)),
            quaternion=still,
            error_matrix=error_matrix(still),
            gain=np.zeros((nsim, 6, 12)),
            null_active=np.zeros(nsim, dtype=bool),
            null_q=np.zeros((nsim, n)),
            null_stiffness=np.zeros((nsim, n)),
            null_damping=np.zeros((nsim, n)),
            projector=np.zeros((nsim, n, n)),
            inertia=np.zeros((nsim, 6, 6)),
            singular=np.zeros(nsim, dtype=bool),
            state=np.zeros((nsim, 12)),
            q=np.zeros((nsim, n)),
            wanted=np.zeros((nsim, n)),
            sent=np.zeros((nsim, n)),
            command=np.zeros((nsim, n)),
        )
        """What compiled functions read and write; always the same objects."""
        self.wanted, self.command = a.wanted, a.command
        """(N, n) torque of the last cycle before and behind the saturation, overwritten [N·m]."""
        self._ratio = np.array(np.broadcast_to(s.damping_ratio, 6), dtype=float)
        self._known = np.zeros(nsim, dtype=bool)
        # with another axis, numbers per axis cannot be taken for numbers per simulation
        self.set_stiffness(
            None,
            translational=np.asarray(s.translational_stiffness)[None],
            rotational=np.asarray(s.rotational_stiffness)[None],
            nullspace=np.atleast_2d(s.nullspace_stiffness),
        )

    # ---- reference and stiffness ---------------------------------------------------------------

    def reset(self, ids: Ids, position: ArrayLike, quaternion: ArrayLike, q: ArrayLike) -> None:
        """Start arms anew: reference and nullspace at their poses, no torque.

        Args:
            ids: (M,) simulations, None for all.
            position: (M, 3) of the end effector in the base frame [m].
            quaternion: (M, 4) of the end effector, w, x, y, z.
            q: (M, n) joint angles [rad].

        The last stiffness that was set is kept.
        """
        rows, a = self._rows(ids), self.arrays
        self._put_pose(rows, position, quaternion, now=True)
        a.null_q[rows] = a.q[rows] = q
        a.wanted[rows] = a.sent[rows] = a.command[rows] = 0.0

    def set_reference(self, position: ArrayLike, quaternion: ArrayLike) -> None:
        """Move all references to (N, 3) [m] and (N, 4) w, x, y, z, in the base frame."""
        self._put_pose(slice(None), position, quaternion, now=False)

    def set_stiffness(
        self,
        ids: Ids,
        *,
        translational: ArrayLike | None = None,
        rotational: ArrayLike | None = None,
        nullspace: ArrayLike | None = None,
    ) -> None:
        """Change the stiffness of arms while they run; None leaves a part unchanged.

        Args:
            ids: (M,) simulations, None for all.
            translational: one number, (M,) or (M, 3) [N/m].
            rotational: one number, (M,) or (M, 3) [N·m/rad].
            nullspace: one number, (M,) or (M, n) [N·m/rad].

        Raises:
            StictionError: negative, not finite or of a wrong shape; nothing has changed then.
        """
        rows, a = self._rows(ids), self.arrays
        new = self.stiffness[rows]
        for name, value, k in (
            ("translational", translational, np.arange(3)),
            ("rotational", rotational, np.arange(3, 6)),
        ):
            if value is not None:
                new[:, k, k] = _fill(f"{name} stiffness", value, (len(new), 3))
        if nullspace is not None:
            shape = (len(new), self.n)
            a.null_stiffness[rows] = _fill("nullspace stiffness", nullspace, shape)
        ratio = self.settings.nullspace_damping_ratio
        a.null_damping[rows] = 2.0 * ratio * np.sqrt(a.null_stiffness[rows])
        a.null_active[rows] = a.null_stiffness[rows].any(axis=1)
        diagonal = np.diagonal(new, axis1=1, axis2=2)
        a.gain[rows, :, :6] = -new
        a.gain[rows, :, 6:] = -(2.0 * self._ratio * np.sqrt(diagonal))[:, :, None] * np.eye(6)

    def _rows(self, ids: Ids) -> Index:
        everyone = np.arange(self.nsim)
        return everyone if ids is None else everyone[np.asarray(ids)]

    def _put_pose(
        self, rows: Index | slice, position: ArrayLike, quaternion: ArrayLike, now: bool
    ) -> None:
        a = self.arrays
        a.position_target[rows], a.quaternion_target[rows] = position, quaternion
        if now or a.filter_step == 1.0:
            a.position[rows], a.quaternion[rows] = position, quaternion
            a.error_matrix[:] = error_matrix(a.quaternion)

    # ---- slow part -----------------------------------------------------------------------------

    def update_model(self, ids: Ids, jacobian: Array, mass: Array) -> None:
        """Compute Λ and P from the dynamics of the present pose.

        Args:
            ids: (M,) simulations, None for all.
            jacobian: (M, 6, n) of the end effector: translation, then rotation, in the base frame.
            mass: (M, n, n) joint-space inertia M(q), rotors included [kg·m²].

        Raises:
            StictionError: an entry that is not finite.
        """
        rows = self._rows(ids)
        jac = np.ascontiguousarray(jacobian)
        mass = np.ascontiguousarray(mass)
        m, n = len(rows), self.n
        if jac.shape != (m, 6, n) or mass.shape != (m, n, n):
            raise StictionError(
                f"update_model: Jacobian {jac.shape} and mass {mass.shape}: expected "
                f"({m}, 6, {n}) and ({m}, {n}, {n})"
            )
        a = self.arrays
        for k, i in enumerate(rows):
            low, singular = (a.singular_below, a.singular_length), a.singular[i : i + 1]
            if not renew(jac[k], mass[k], True, *low, singular, a.inertia[i], a.projector[i]):
                finite = np.isfinite(mass[k]).all() and np.isfinite(jac[k]).all()
                what = "mass is singular: expected positive definite"
                other = "Jacobian or mass: expected finite numbers"
                raise StictionError(f"row {k}: {what if finite else other}")
        self._known[rows] = True

    # ---- fast part -----------------------------------------------------------------------------

    def torque(
        self,
        position: Array,
        quaternion: Array,
        jacobian: Array,
        q: Array,
        dq: Array,
        dither: Array | None = None,
    ) -> Array:
        """One control cycle of all arms: advance the filters, return the command.

        Args:
            position: (N, 3) measured, base frame [m].
            quaternion: (N, 4) measured, w, x, y, z.
            jacobian: (N, 6, n) translation, then rotation, base frame.
            q: (N, n) joint angles [rad].
            dq: (N, n) joint speeds [rad/s].
            dither: (N, n) [N·m].

        Returns:
            (N, n) commanded torque without gravity, a fresh array [N·m]. It is within the torque
            limits; without dither behind the saturation it is also within the torque rate.

        Raises:
            StictionError: a simulation without a model.
        """
        if not self._known.all():
            missing = int(np.argmin(self._known))
            raise StictionError(f"torque of simulation {missing}: update_model has to be called")
        # compiled code does not check sizes
        added = np.broadcast_to(0.0 if dither is None else dither, self.command.shape).copy()
        for i in range(self.nsim):
            if self.arrays.filter_step < 1.0:
                advance_reference(i, self.arrays)
            impedance_cycle(i, position, quaternion, jacobian, q, dq, added, self.arrays)
        return self.command.copy()

    # ---- state ---------------------------------------------------------------------------------

    @property
    def flags(self) -> Flags:
        """Flags of the last cycle and the last `update_model`, fresh arrays."""
        out = np.zeros((self.nsim, 3), dtype=bool)
        for i in range(self.nsim):
            read_flags(i, self.arrays, out[i])
        return Flags(*out.T)

    @property
    def error(self) -> Array:
        """(N, 6) error e of the last cycle: translation [m], then rotation [rad]."""
        return self.arrays.state[:, :6].copy()

    @property
    def reference(self) -> tuple[Array, Array]:
        """Filtered reference pose: (N, 3) [m] and (N, 4)."""
        return self.arrays.position.copy(), self.arrays.quaternion.copy()

    @property
    def stiffness(self) -> Array:
        """(N, 6, 6) K [N/m, N/rad, N·m/rad]."""
        return -self.arrays.gain[:, :, :6]

    @property
    def damping(self) -> Array:
        """(N, 6, 6) D in use [N·s/m, N·s/rad, N·m·s/rad]."""
        return -self.arrays.gain[:, :, 6:]


def _fill(name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    """``value`` as array of ``shape`` (M, k); (M,) is one number per simulation."""
    array = numbers(name, value)
    if array.ndim == 1:
        array = array[:, None]
    try:
        return np.array(np.broadcast_to(array, shape))
    except ValueError:
        raise StictionError(
            f"impedance {name} has shape {np.shape(value)}: expected one number, "
            f"({shape[0]},) or {shape}"
        ) from None
