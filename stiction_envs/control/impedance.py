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

from stiction_envs.compiled import Arguments
from stiction_envs.control.kernels import advance_reference, impedance_cycle
from stiction_envs.control.operational import renew
from stiction_envs.control.rotation import error_matrix, write_error_matrix
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
        self._limit = np.array(limits.torque)
        self._low = limits.position[:, 0] + settings.limit_margin
        self._high = limits.position[:, 1] - settings.limit_margin
        self._stiffness, self._null_stiffness = np.zeros((nsim, 6, 6)), np.zeros((nsim, n))
        self._filter_step = settings.filter_step
        self._position, self._position_target = np.zeros((2, nsim, 3))
        self._quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (nsim, 1))
        self._quaternion_target = self._quaternion.copy()
        self._error_matrix = error_matrix(self._quaternion)
        self._gain = np.zeros((nsim, 6, 12))  # wrench = gain · (e, J q̇): [−K, −D]
        self._null_damping = np.zeros((nsim, n))
        self._null_active = False
        self._ratio = np.array(np.broadcast_to(settings.damping_ratio, 6), dtype=float)
        self._known, self._singular = np.zeros((2, nsim), dtype=bool)
        self.inertia = np.zeros((nsim, 6, 6))
        """(N, 6, 6) Λ of the last `update_model`, overwritten by the next [kg, kg·m, kg·m²]."""
        self.projector = np.zeros((nsim, n, n))
        """(N, n, n) P of the last `update_model`, overwritten by the next [-]."""
        self._state = np.zeros((nsim, 12))
        self._q, self._null_q, self._sent = np.zeros((3, nsim, n))
        self.wanted, self.command = np.zeros((2, nsim, n))
        """(N, n) torque of the last cycle before and behind the saturation, overwritten [N·m]."""
        self._everyone = np.arange(nsim)
        s = settings
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
        rows = self._rows(ids)
        self._put_pose(rows, position, quaternion, now=True)
        self._null_q[rows] = q
        self.wanted[rows] = self._sent[rows] = self.command[rows] = 0.0
        self._q[rows] = q

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
        rows = self._rows(ids)
        new, axes = self._stiffness[rows].copy(), np.arange(6)
        for name, value, k in (
            ("translational", translational, axes[:3]),
            ("rotational", rotational, axes[3:]),
        ):
            if value is not None:
                new[:, k, k] = _fill(f"{name} stiffness", value, (len(new), 3))
        if nullspace is not None:
            shape = (len(new), self.n)
            self._null_stiffness[rows] = _fill("nullspace stiffness", nullspace, shape)
        self._stiffness[rows], self._gain[rows, :, :6] = new, -new
        self._null_active = bool(self._null_stiffness.any())
        ratio = self.settings.nullspace_damping_ratio
        self._null_damping[rows] = 2.0 * ratio * np.sqrt(self._null_stiffness[rows])
        diagonal = np.diagonal(new, axis1=1, axis2=2)
        self._gain[rows, :, 6:] = -(2.0 * self._ratio * np.sqrt(diagonal))[:, :, None] * np.eye(6)

    def _rows(self, ids: Ids) -> Index:
        return self._everyone if ids is None else self._everyone[np.asarray(ids)]

    def _put_pose(
        self, rows: Index | slice, position: ArrayLike, quaternion: ArrayLike, now: bool
    ) -> None:
        self._position_target[rows], self._quaternion_target[rows] = position, quaternion
        if now or self._filter_step == 1.0:
            self._position[rows], self._quaternion[rows] = position, quaternion
            write_error_matrix(self._quaternion, self._error_matrix)

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
        bad = renew(rows, jac, mass, True, *self.model_arguments[1:])
        if bad >= 0:
            finite = np.isfinite(mass[bad]).all() and np.isfinite(jac[bad]).all()
            what = "mass is singular: expected positive definite"
            other = "Jacobian or mass: expected finite numbers"
            raise StictionError(f"row {bad}: {what if finite else other}")
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
        arguments = self.arguments
        self.advance_filter()
        # compiled code does not check sizes
        added = np.broadcast_to(0.0 if dither is None else dither, self._q.shape).copy()
        impedance_cycle(position, quaternion, jacobian, q, dq, added, *arguments)
        return self.command.copy()

    @property
    def arguments(self) -> Arguments:
        """The arguments of `kernels.impedance_cycle` after the dither.

        `torque` is `advance_filter`, then that function with them. They stay the same objects
        until stiffness or nullspace stiffness are changed.

        Raises:
            StictionError: a simulation without a model.
        """
        if not self._known.all():
            missing = int(np.argmin(self._known))
            raise StictionError(f"torque of simulation {missing}: update_model has to be called")
        return (
            self.settings.dither_after_saturation,
            self.settings.torque_rate,
            self._limit,
            self._position,
            self._error_matrix,
            self._gain,
            self._null_active,
            self._null_q,
            self._null_stiffness,
            self._null_damping,
            self.projector,
            self._state,
            self._q,
            self.wanted,
            self._sent,
            self.command,
        )

    @property
    def model_arguments(self) -> Arguments:
        """The arguments of `operational.renew` after the inertias.

        Λ and P are renewed while arms follow where a nullspace torque needs them.
        """
        low = self.settings.singular_below, self.settings.singular_length
        return self._null_active, *low, self._singular, self.inertia, self.projector

    @property
    def filters(self) -> bool:
        """Whether the reference moves in every cycle."""
        return self._filter_step < 1.0

    @property
    def reference_arguments(self) -> Arguments:
        """The arguments of `kernels.advance_reference`; always the same objects."""
        return (
            self._filter_step,
            self._position_target,
            self._quaternion_target,
            self._position,
            self._quaternion,
            self._error_matrix,
        )

    def advance_filter(self) -> None:
        """Move the reference one cycle towards its target; `torque` does it too."""
        if self.filters:
            advance_reference(*self.reference_arguments)

    # ---- state ---------------------------------------------------------------------------------

    @property
    def flags(self) -> Flags:
        """Flags of the last cycle and the last `update_model`, fresh arrays."""
        cut = (self.wanted != self._sent) | (np.abs(self.command) >= self._limit)
        near = (self._q < self._low) | (self._q > self._high)
        return Flags(self._singular.copy(), np.any(cut, axis=1), np.any(near, axis=1))

    @property
    def error(self) -> Array:
        """(N, 6) error e of the last cycle: translation [m], then rotation [rad]."""
        return self._state[:, :6].copy()

    @property
    def reference(self) -> tuple[Array, Array]:
        """Filtered reference pose: (N, 3) [m] and (N, 4)."""
        return self._position.copy(), self._quaternion.copy()

    @property
    def stiffness(self) -> Array:
        """(N, 6, 6) K [N/m, N/rad, N·m/rad]."""
        return self._stiffness.copy()

    @property
    def damping(self) -> Array:
        """(N, 6, 6) D in use [N·s/m, N·s/rad, N·m·s/rad]."""
        return -self._gain[:, :, 6:]


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
