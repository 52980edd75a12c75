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
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.control.kernels import impedance_cycle
from stiction_envs.control.operational import damp_by_mass, renew
from stiction_envs.control.rotation import error_matrix, slerp, write_error_matrix
from stiction_envs.control.settings import FILTERS, ImpedanceSettings, numbers
from stiction_envs.errors import StictionError
from stiction_envs.robots import Limits

__all__ = ["CartesianImpedance", "Flags", "ImpedanceSettings"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Ids = Index | Sequence[int] | None
"""Simulations a call is about; None means all."""
Rows = Index | slice


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
    are held in between. In singular poses Λ, D and P are bounded (`operational`) and the flag
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
        step = settings.filter_step
        self._stiffness = _Filtered((nsim, 6, 6), step("stiffness_filter"))
        self._null_stiffness = _Filtered((nsim, n), step("stiffness_filter"))
        self._position = _Filtered((nsim, 3), step("pose_filter"))
        self._filtering = any(step(name) < 1.0 for name in FILTERS)
        self._quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (nsim, 1))
        self._quaternion_target = self._quaternion.copy()
        self._error_matrix = error_matrix(self._quaternion)
        self._gain = np.zeros((nsim, 6, 12))  # wrench = gain · (e, J q̇): [−K, −D]
        self._null_damping = np.zeros((nsim, n))
        self._null_active = False
        self._known, self._singular = np.zeros((2, nsim), dtype=bool)
        self._root, self._inverse_root, self._modes, self._inertia = np.zeros((4, nsim, 6, 6))
        self._projector = np.zeros((nsim, n, n))
        self._state = np.zeros((nsim, 12))
        self._q, self._null_q, self._wanted, self._sent, self._command = np.zeros((5, nsim, n))
        self._everyone = np.arange(nsim)
        s = settings
        self._write_stiffness(
            slice(None),
            # with one axis more, what is given per axis cannot be taken for one per simulation
            np.asarray(s.translational_stiffness)[None],
            np.asarray(s.rotational_stiffness)[None],
            np.atleast_2d(s.nullspace_stiffness),
            now=True,
        )

    # ---- reference and stiffness ---------------------------------------------------------------

    def reset(self, ids: Ids, position: ArrayLike, quaternion: ArrayLike, q: ArrayLike) -> None:
        """Start arms anew: reference and nullspace at their poses, filters settled, no torque.

        Args:
            ids: (M,) simulations, None for all.
            position: (M, 3) of the end effector in the base frame [m].
            quaternion: (M, 4) of the end effector, w, x, y, z.
            q: (M, n) joint angles [rad].

        The last stiffness that was set is kept.
        """
        rows = _rows_of(ids)
        self._put_pose(rows, position, quaternion, now=True)
        self._null_q[rows] = q
        for filtered in (self._stiffness, self._null_stiffness):
            filtered.put(rows, filtered.target[rows], now=True)
        self._refresh(rows)
        self._wanted[rows] = self._sent[rows] = self._command[rows] = 0.0
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

        The filter approaches it cycle by cycle. The damping of the design ``mass`` follows at the
        next `update_model` where the filter is on, immediately where it is off.

        Raises:
            StictionError: negative, not finite or of a wrong shape; nothing has changed then.
        """
        self._write_stiffness(_rows_of(ids), translational, rotational, nullspace)

    def _write_stiffness(
        self,
        rows: Rows,
        translational: ArrayLike | None,
        rotational: ArrayLike | None,
        nullspace: ArrayLike | None,
        now: bool = False,
    ) -> None:
        new, axes = self._stiffness.target[rows].copy(), np.arange(6)
        for name, value, k in (
            ("translational", translational, axes[:3]),
            ("rotational", rotational, axes[3:]),
        ):
            if value is not None:
                new[:, k, k] = _fill(f"{name} stiffness", value, (len(new), 3))
        null = self._null_stiffness.target[rows].copy()
        if nullspace is not None:
            null = _fill("nullspace stiffness", nullspace, null.shape)
        self._stiffness.put(rows, new, now=now)
        self._null_stiffness.put(rows, null, now=now)
        self._null_active = bool(
            self._null_stiffness.target.any() or self._null_stiffness.value.any()
        )
        if now or self._stiffness.step == 1.0:
            self._refresh(rows)

    def _put_pose(self, rows: Rows, position: ArrayLike, quaternion: ArrayLike, now: bool) -> None:
        self._position.put(rows, position, now=now)
        self._quaternion_target[rows] = quaternion
        if now or self._position.step == 1.0:
            self._quaternion[rows] = quaternion
            write_error_matrix(self._quaternion, self._error_matrix)

    def _refresh(self, rows: Rows) -> None:
        """Write gains and damping for the present stiffness."""
        self._gain[rows, :, :6] = -self._stiffness.value[rows]
        self._damp_nullspace(rows)
        self._damp(self._everyone[rows])

    def _damp_nullspace(self, rows: Rows) -> None:
        ratio = self.settings.nullspace_damping_ratio
        self._null_damping[rows] = 2.0 * ratio * np.sqrt(self._null_stiffness.value[rows])

    # ---- slow part -----------------------------------------------------------------------------

    def update_model(self, ids: Ids, jacobian: Array, mass: Array) -> None:
        """Compute Λ, D and P from the dynamics of the present pose.

        Args:
            ids: (M,) simulations, None for all.
            jacobian: (M, 6, n) of the end effector: translation, then rotation, in the base frame.
            mass: (M, n, n) joint-space inertia M(q), rotors included [kg·m²].

        Raises:
            StictionError: an entry that is not finite.
        """
        settings = self.settings
        rows = self._everyone if ids is None else self._everyone[np.asarray(ids)]
        jac = np.ascontiguousarray(jacobian)
        mass = np.ascontiguousarray(mass)
        m, n = len(rows), self.n
        if jac.shape != (m, 6, n) or mass.shape != (m, n, n):
            raise StictionError(
                f"update_model: Jacobian {jac.shape} and mass {mass.shape}: expected "
                f"({m}, 6, {n}) and ({m}, {n}, {n})"
            )
        bad = renew(
            rows,
            jac,
            mass,
            settings.singular_below,
            settings.singular_length,
            self._singular,
            self._inertia,
            self._root,
            self._inverse_root,
            self._modes,
            self._projector,
        )
        if bad >= 0:
            finite = np.isfinite(mass[bad]).all() and np.isfinite(jac[bad]).all()
            what = "mass is singular: expected positive definite"
            other = "Jacobian or mass: expected finite numbers"
            raise StictionError(f"row {bad}: {what if finite else other}")
        self._known[rows] = True
        self._damp(rows)

    def _damp(self, rows: Index) -> None:
        """Write −D of the present stiffness; 0 for ``mass`` before the first model."""
        stiffness, ratio = self._stiffness.value, np.asarray(self.settings.damping_ratio)
        if self.settings.damping_design == "mass":
            damp_by_mass(
                rows,
                stiffness,
                ratio,
                self._root,
                self._inverse_root,
                self._modes,
                self._gain[:, :, 6:],
            )
            return
        diagonal = np.diagonal(stiffness[rows], axis1=1, axis2=2)
        self._gain[rows, :, 6:] = -(2.0 * ratio * np.sqrt(diagonal))[:, :, None] * np.eye(6)

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
        self.advance_filters()
        # compiled code does not check sizes
        added = np.broadcast_to(0.0 if dither is None else dither, self._q.shape).copy()
        impedance_cycle(position, quaternion, jacobian, q, dq, added, *arguments)
        return self._command.copy()

    @property
    def arguments(self) -> tuple[Any, ...]:
        """The arguments of `kernels.impedance_cycle` after the dither.

        `torque` is `advance_filters`, then that function with them. They stay the same objects
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
            self._position.value,
            self._error_matrix,
            self._gain,
            self._null_active,
            self._null_q,
            self._null_stiffness.value,
            self._null_damping,
            self._projector,
            self._state,
            self._q,
            self._wanted,
            self._sent,
            self._command,
        )

    def advance_filters(self) -> None:
        """Move stiffness and poses one cycle towards their targets; `torque` does it too."""
        if not self._filtering:
            return
        if self._stiffness.advance():
            np.negative(self._stiffness.value, out=self._gain[:, :, :6])
        if self._null_stiffness.advance():
            self._damp_nullspace(slice(None))
        if self._position.advance():
            self._quaternion = slerp(self._quaternion, self._quaternion_target, self._position.step)
            write_error_matrix(self._quaternion, self._error_matrix)

    # ---- state ---------------------------------------------------------------------------------

    @property
    def flags(self) -> Flags:
        """Flags of the last cycle and the last `update_model`, fresh arrays."""
        cut = (self._wanted != self._sent) | (np.abs(self._command) >= self._limit)
        near = (self._q < self._low) | (self._q > self._high)
        return Flags(self._singular.copy(), np.any(cut, axis=1), np.any(near, axis=1))

    @property
    def command(self) -> Array:
        """(N, n) command of the last cycle, overwritten by the next [N·m]."""
        return self._command

    @property
    def wanted(self) -> Array:
        """(N, n) torque of the last cycle before the saturation, overwritten by the next [N·m]."""
        return self._wanted

    @property
    def error(self) -> Array:
        """(N, 6) error e of the last cycle: translation [m], then rotation [rad]."""
        return self._state[:, :6].copy()

    @property
    def reference(self) -> tuple[Array, Array]:
        """Filtered reference pose: (N, 3) [m] and (N, 4)."""
        return self._position.value.copy(), self._quaternion.copy()

    @property
    def stiffness(self) -> Array:
        """(N, 6, 6) filtered K [N/m, N/rad, N·m/rad]."""
        return self._stiffness.value.copy()

    @property
    def damping(self) -> Array:
        """(N, 6, 6) D in use [N·s/m, N·s/rad, N·m·s/rad]."""
        return -self._gain[:, :, 6:]

    @property
    def inertia(self) -> Array:
        """(N, 6, 6) Λ of the last `update_model` [kg, kg·m, kg·m²]."""
        return self._inertia.copy()

    @property
    def projector(self) -> Array:
        """(N, n, n) P of the last `update_model` [-]."""
        return self._projector.copy()


class _Filtered:
    """A row per simulation that follows its target: x ← x + s (target − x)."""

    def __init__(self, shape: tuple[int, ...], step: float) -> None:
        self.value, self.target, self.step = np.zeros(shape), np.zeros(shape), step

    def put(self, rows: Rows, value: ArrayLike, now: bool = False) -> None:
        """Set the target of some rows; where the filter is off, or ``now``, the value too."""
        self.target[rows] = value
        if now or self.step == 1.0:
            self.value[rows] = value

    def advance(self) -> bool:
        """One cycle; False where the filter is off."""
        if self.step == 1.0:
            return False
        self.value += self.step * (self.target - self.value)
        return True


def _rows_of(ids: ArrayLike | None) -> Rows:
    """Return the index of simulations ``ids`` (M,), or of all for None."""
    return slice(None) if ids is None else np.asarray(ids)


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
