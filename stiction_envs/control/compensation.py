"""Friction compensation, the usual alternative to dither: gains, their files, N arms.

The laws are in `laws`, a file each. What they may use is what a controller has: measured angles and
speeds, the reference, its own model of the arm's dynamics, and the torque that it commanded.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.compiled import Arguments, compiled
from stiction_envs.control.kernels import pose_error
from stiction_envs.control.laws import LAWS, law_torque
from stiction_envs.control.laws.base import (
    ERROR,
    GRAVITY,
    PUSHED,
    SEEN,
    SPEED,
    TORQUE,
    WANTED_SPEED,
)
from stiction_envs.errors import StictionError, unknown
from stiction_envs.friction.parameters import FrictionParameters

Array = NDArray[np.float64]
Index = NDArray[np.int64]
KINDS = tuple(LAWS)
_MOST = 1 + max(len(law.fields) for law in LAWS.values())
_READS_ERROR = np.array([law.reads_error for law in LAWS.values()])
_READS_MOMENTUM = np.array([law.reads_momentum for law in LAWS.values()])
Numbers = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Compensation:
    """Friction compensation of the n joints of one arm by one of the `laws`.

    Numbers are one per joint, or one for all; empty ones are the defaults of ``gte.toml``, which
    has their sources. A number that the law does not have must stay empty.
    """

    kind: str
    """One of :data:`KINDS`."""
    gain: Numbers
    """g (n,), ≥ 0 [N·m]; a joint with gain 0 is not compensated."""
    speed: Numbers = ()
    """v (n,), > 0 [rad/s]: speed at which a tanh is 76 % of its gain, or a push has faded to 1/e;
    v_s of the LuGre observer."""
    error: Numbers = ()
    """w (n,), > 0 [rad]: joint error at which a push is 76 % of its gain."""
    load: Numbers = ()
    """c (n,) of a push: what the gain grows by per N·m of gravity torque [-]."""
    viscous: Numbers = ()
    """b (n,) [N·m·s/rad]."""
    coulomb: Numbers = ()
    """F_c (n,), > 0, of the LuGre observer, whose gain is F_s [N·m]."""
    stiffness: Numbers = ()
    """σ0 (n,), > 0 [N·m/rad]."""
    damping: Numbers = ()
    """σ1 (n,) [N·m·s/rad]."""
    injection: Numbers = ()
    """k (n,): how much the joint error corrects the LuGre bristle [1/s]."""
    rate: Numbers = ()
    """K (n,), > 0, of the momentum observer [1/s]."""
    share: Numbers = ()
    """s (n,): how much of the disturbance the momentum observer feeds back, at most 1 [-]."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise unknown("compensation", self.kind, KINDS)
        law = LAWS[self.kind]
        gain = _numbers("gain", self.gain, None)
        if gain.ndim != 1 or not len(gain):
            raise StictionError("compensation gain: expected one number per joint [N·m]")
        own = {field.name: field for field in law.fields}
        _check("gain", gain, "N·m")
        object.__setattr__(self, "gain", tuple(map(float, gain)))
        for name in NUMBERS[1:]:
            given = getattr(self, name)
            if name not in own:
                if np.size(given):
                    raise StictionError(
                        f"compensation {name}: {self.kind} has none: expected {', '.join(own)}"
                    )
                object.__setattr__(self, name, ())
                continue
            field = own[name]
            if not np.size(given):
                if not field.optional:
                    raise StictionError(f"compensation {name}: {self.kind} needs it [{field.unit}]")
                given = law.default(name)
            values = _numbers(name, given, len(gain))
            _check(name, values, field.unit, positive=field.positive, largest=field.largest)
            object.__setattr__(self, name, tuple(map(float, values)))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.gain)

    def packed(self) -> Array:
        """Return (n, K) numbers as the compiled law takes them."""
        out = np.zeros((self.n, _MOST))
        out[:, 0] = self.gain
        for k, field in enumerate(LAWS[self.kind].fields, 1):
            values = np.array(getattr(self, field.name))
            out[:, k] = 1.0 / values if field.inverse else values
        return out

    def times(self, factor: float) -> Compensation:
        """Return the compensation of ``factor`` times as much friction.

        Raises:
            StictionError: a factor that is not ≥ 0.
        """
        if not 0 <= factor < np.inf:
            raise StictionError(f"compensation factor {factor}: expected >= 0")
        if factor == 0:  # no friction at all has no bristle
            return dataclasses.replace(self, gain=(0.0,) * self.n)
        names = ["gain", *(field.name for field in LAWS[self.kind].fields if field.scales)]
        changes: dict[str, Any] = {
            name: tuple(factor * x for x in getattr(self, name)) for name in names
        }
        return dataclasses.replace(self, **changes)

    @classmethod
    def from_friction(
        cls,
        kind: str,
        friction: FrictionParameters,
        factor: float = 1.0,
        *,
        load: ArrayLike = 0.0,
    ) -> Compensation:
        """Return the compensation that takes ``friction`` for true.

        Args:
            kind: one of :data:`KINDS`.
            friction: of one arm; directions are averaged.
            factor: multiplies the friction [-].
            load: (n,) transmitted torque at which friction is taken [N·m].

        Raises:
            StictionError: another kind, or a factor that is not ≥ 0.
        """
        if kind not in KINDS:
            raise unknown("compensation", kind, KINDS)
        gains = LAWS[kind].gains(friction, np.broadcast_to(load, friction.n))
        return cls(kind=kind, **{name: tuple(x) for name, x in gains.items()}).times(factor)


NUMBERS = tuple(f.name for f in dataclasses.fields(Compensation) if f.name != "kind")
"""Names of the numbers of all laws, the gain first."""


class Compensator:
    """Compensation of N arms; each arm has its own compensation, or none."""

    def __init__(
        self,
        nsim: int,
        n: int,
        *,
        damping: float,
        command: Array | None = None,
        mass: Array | None = None,
        period: float = 1e-3,
    ) -> None:
        """Start without compensation.

        Args:
            nsim: number of arms N.
            n: joints of each.
            damping: λ of J^# [m and rad].
            command: (N, n) torque of the controller's last cycle, kept up to date by others [N·m].
            mass: (N, n, n) joint-space inertia of the controller's model, likewise [kg·m²].
            period: of the controller's cycles [s].
        """
        self.n, self._damping, self._period = n, damping, period
        self.active = False
        """Whether any arm is compensated."""
        self.feeds = False
        """Whether `look_ahead` is needed."""
        self.reads_model = False
        """Whether `gravity` and `coriolis` are needed."""
        self._kind = np.full(nsim, -1)
        self._given: list[Compensation | None] = [None] * nsim
        self._packed = np.zeros((nsim, n, _MOST))
        self._state, self._last_speed = np.zeros((nsim, n, 1)), np.zeros((nsim, n))
        self._command = np.zeros((nsim, n)) if command is None else command
        self._mass = np.zeros((nsim, n, n)) if mass is None else mass
        self.wanted_speed = np.zeros((nsim, n))
        """(N, n) q̇_d, kept up to date by `look_ahead` [rad/s]."""
        self.gravity, self.coriolis = np.zeros((2, nsim, n))
        """(N, n) of the controller's model, kept up to date by others where `reads_model` [N·m]."""
        self.torque = np.zeros((nsim, n))
        """(N, n) of the last controller cycle, overwritten by the next [N·m]."""

    def set_rows(self, ids: Index, compensations: Sequence[Compensation | None]) -> None:
        """Set the compensation of arms ``ids``; None switches it off. Observers start anew.

        Raises:
            StictionError: a compensation of another number of joints.
        """
        for i, c in zip(ids, compensations, strict=True):
            if c is not None and c.n != self.n:
                raise StictionError(f"compensation of {c.n} joints: expected {self.n}")
            self._given[i] = c
            self._kind[i] = KINDS.index(c.kind) if c is not None and any(c.gain) else -1
            self._packed[i] = c.packed() if c is not None else 0.0
        used = {c for c in self._given if c is not None and any(c.gain)}
        self.active = bool(used)
        self.feeds = any(LAWS[c.kind].feeds for c in used)
        self.reads_model = any(LAWS[c.kind].reads_model(vars(c)) for c in used)
        self.reset(ids)

    def reset(self, ids: Index) -> None:
        """Let arms ``ids`` start at rest: observers have seen nothing."""
        self._state[ids], self._last_speed[ids], self.torque[ids] = 0.0, 0.0, 0.0

    def look_ahead(self, jacobian: Array, twist: Array) -> None:
        """Update q̇_d from the Jacobian (N, 6, n) and the reference's twist (N, 6) [m/s, rad/s]."""
        damped = jacobian @ jacobian.transpose(0, 2, 1) + self._damping**2 * np.eye(6)
        pulled = np.linalg.solve(damped, twist[:, :, None])
        self.wanted_speed[:] = (jacobian.transpose(0, 2, 1) @ pulled)[:, :, 0]

    @property
    def arguments(self) -> Arguments:
        """The last of `compensate`, its result at the end."""
        return (
            *(self._kind, self._packed, self._state, self._last_speed, self.wanted_speed),
            *(self.gravity, self.coriolis, self._mass, self._command, self._period, self.torque),
        )


@compiled
def compensate(
    position: Array,
    quaternion: Array,
    jacobian: Array,
    dq: Array,
    reference: Array,
    error_matrix: Array,
    impedance: Array,
    kind: Index,
    numbers: Array,
    state: Array,
    last_speed: Array,
    wanted_speed: Array,
    gravity: Array,
    coriolis: Array,
    mass: Array,
    command: Array,
    period: float,
    torque: Array,
) -> None:
    """Write the compensation of N arms.

    Args:
        position: (N, 3) measured [m].
        quaternion: (N, 4) measured.
        jacobian: (N, 6, n).
        dq: (N, n) measured [rad/s].
        reference: (N, 3) [m].
        error_matrix: (N, 4, 4) of `rotation.error_matrix`.
        impedance: (N, 6, 12) of a `CartesianImpedance`: its first six columns are −K.
        kind: (N,) number of the law, −1 for none.
        numbers: (N, n, K) of `Compensation.packed`.
        state: (N, n, 1) of the laws, changed.
        last_speed: (N, n) measured a cycle ago, changed [rad/s].
        wanted_speed: (N, n) q̇_d [rad/s].
        gravity: (N, n) of the controller's model [N·m].
        coriolis: (N, n) Coriolis and centrifugal torque of that model [N·m].
        mass: (N, n, n) of that model, rotors included [kg·m²].
        command: (N, n) torque of the last cycle, without gravity [N·m].
        period: of a cycle [s].
        torque: (N, n), written [N·m].
    """
    n = dq.shape[1]
    error, wrench, seen = np.empty(6), np.empty(6), np.zeros(SEEN)
    for i in range(len(position)):
        for j in range(n):
            torque[i, j] = 0.0
        law = kind[i]
        if law < 0:
            continue
        if _READS_ERROR[law]:
            pose_error(position[i], quaternion[i], reference[i], error_matrix[i], error)
            for k in range(6):
                wrench[k] = 0.0
                for m in range(6):
                    wrench[k] += impedance[i, k, m] * error[m]
        for j in range(n):
            if numbers[i, j, 0] <= 0.0:
                continue
            seen[WANTED_SPEED], seen[SPEED] = wanted_speed[i, j], dq[i, j]
            if _READS_ERROR[law]:
                pull, stiffness = 0.0, 0.0
                for k in range(6):
                    pull += jacobian[i, k, j] * wrench[k]
                    for m in range(6):
                        stiffness -= jacobian[i, k, j] * impedance[i, k, m] * jacobian[i, m, j]
                # a joint that the impedance does not hold has no error
                seen[ERROR] = pull / stiffness if stiffness > 0.0 else 0.0
            seen[GRAVITY], seen[TORQUE] = gravity[i, j], command[i, j] - coriolis[i, j]
            if _READS_MOMENTUM[law]:
                gained = 0.0
                for m in range(n):
                    gained += mass[i, j, m] * (dq[i, m] - last_speed[i, m])
                seen[PUSHED] = gained
            torque[i, j] = law_torque(law, numbers[i, j], seen, state[i, j], period)
        for j in range(n):
            last_speed[i, j] = dq[i, j]


def _numbers(name: str, value: object, n: int | None) -> Array:
    """Return finite numbers (n,) from one number or (n,)."""
    try:
        array = np.array(value, dtype=float)
        array = array if n is None else np.array(np.broadcast_to(array, (n,)))
    except (TypeError, ValueError):
        expected = "numbers" if n is None else f"one number, or {n}"
        raise StictionError(f"compensation {name} is {value!r}: expected {expected}") from None
    if not np.isfinite(array).all():
        raise StictionError(f"compensation {name} is {value!r}: expected finite numbers")
    return array


def _check(
    name: str, values: Array, unit: str, *, positive: bool = False, largest: float = np.inf
) -> None:
    bad = (values <= 0 if positive else values < 0) | (values > largest)
    if bad.any():
        j = int(np.argmax(bad))
        expected = f"> 0 {unit}" if positive else f">= 0 {unit}"
        expected += f" and <= {largest:g}" if largest < np.inf else ""
        raise StictionError(
            f"compensation {name} of joint {j + 1} is {values[j]:g}: expected {expected}"
        )
