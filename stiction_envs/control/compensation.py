"""Friction compensation, the usual alternative to dither: gains, their files, N arms.

The laws are in `laws`, a file each. What they may use is what a controller has: measured angles and
speeds, the reference, its own model of the arm's dynamics, and the torque that it commanded.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled
from stiction_envs.control.impedance import Impedance, pose_error
from stiction_envs.control.laws import LAWS, law_torque
from stiction_envs.control.laws.base import (
    ERROR,
    GAIN_FIELD,
    GRAVITY,
    PUSHED,
    SEEN,
    SPEED,
    TORQUE,
    WANTED_SPEED,
)
from stiction_envs.errors import StictionError, checked_array, unknown
from stiction_envs.friction.parameters import FrictionParameters

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

    kind: str  # One of :data:`KINDS`
    gain: Numbers  # g (n,), ≥ 0 [N·m]; a joint with gain 0 is not compensated
    speed: Numbers = ()
    """v (n,), > 0 [rad/s]: speed at which a tanh is 76 % of its gain, or a push has faded to 1/e;
    v_s of the LuGre observer."""
    error: Numbers = ()  # w (n,), > 0 [rad]: joint error at which a push is 76 % of its gain
    load: Numbers = ()  # c (n,) of a push: what the gain grows by per N·m of gravity torque [-]
    viscous: Numbers = ()  # b (n,) [N·m·s/rad]
    coulomb: Numbers = ()  # F_c (n,), > 0, of the LuGre observer, whose gain is F_s [N·m]
    stiffness: Numbers = ()  # σ0 (n,), > 0 [N·m/rad]
    damping: Numbers = ()  # σ1 (n,) [N·m·s/rad]
    injection: Numbers = ()  # k (n,): how much the joint error corrects the LuGre bristle [1/s]
    rate: Numbers = ()  # K (n,), > 0, of the momentum observer [1/s]
    share: Numbers = ()  # s (n,) ≤ 1 of the momentum observer: share of r that is fed back [-]

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise unknown("compensation", self.kind, KINDS)
        law = LAWS[self.kind]
        expected = "finite numbers, one number per joint [N·m]"
        gain = checked_array(self.gain, "compensation gain", expected=expected)
        if gain.ndim != 1 or not len(gain):
            raise StictionError(f"compensation gain: expected {expected}")
        own = {field.name: field for field in (GAIN_FIELD, *law.fields)}
        for name in NUMBERS:
            given, field = getattr(self, name), own.get(name)
            if field is None:
                if np.size(given):
                    expected = ", ".join(f.name for f in law.fields)
                    raise StictionError(
                        f"compensation {name}: {self.kind} has none: expected {expected}"
                    )
                object.__setattr__(self, name, ())
                continue
            if not np.size(given):
                if not field.optional:
                    raise StictionError(f"compensation {name}: {self.kind} needs it [{field.unit}]")
                given = law.default(name)
            expected = f"one number, or {len(gain)} [{field.unit}]"
            values = checked_array(
                given, f"compensation {name}", gain.shape, expected=expected, fill=True
            )
            bad = (values <= 0 if field.positive else values < 0) | (values > field.largest)
            for j in np.flatnonzero(bad):
                raise StictionError(
                    f"compensation {name} of joint {j + 1} is {values[j]:g}: "
                    f"expected {field.expected}"
                )
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
        """Return the compensation of ``factor`` times as much friction; raise for a factor < 0."""
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
        cls, kind: str, friction: FrictionParameters, factor: float = 1.0, *, load: ArrayLike = 0.0
    ) -> Compensation:
        """Return the compensation that takes the friction of one arm for true, directions averaged.

        ``factor`` multiplies the friction [-]; ``load`` (n,) is the transmitted torque [N·m].
        """
        if kind not in KINDS:
            raise unknown("compensation", kind, KINDS)
        gains = LAWS[kind].gains(friction, np.broadcast_to(load, friction.n))
        return cls(kind=kind, **{name: tuple(x) for name, x in gains.items()}).times(factor)


NUMBERS = tuple(f.name for f in dataclasses.fields(Compensation) if f.name != "kind")
"""Names of the numbers of all laws, the gain first."""


class Compensations(NamedTuple):
    """Compensation of N arms of n joints."""

    damping: float  # λ of J^# [m and rad]
    period: float  # Period of the controller's cycles [s]
    kind: Index  # (N,) number of the law, −1 for none
    feeds: Bools  # (N,) whether the law reads `wanted_speed`
    reads_model: Bools  # (N,) whether the law reads `gravity` and `coriolis`
    numbers: Array  # (N, n, K) of `Compensation.packed`
    state: Array  # (N, n, 1) of the laws, changed
    last_speed: Array  # (N, n) speeds measured a cycle ago, changed [rad/s]
    wanted_speed: Array  # (N, n) q̇_d, written by `look_ahead` [rad/s]
    gravity: Array  # (N, n) of the controller's model, written by others [N·m]
    coriolis: Array  # (N, n) Coriolis and centrifugal torque of that model, written by others [N·m]
    torque: Array  # (N, n) of the last cycle, written by `compensate` [N·m]


class Compensator:
    """Compensation of N arms; each arm has its own compensation, or none."""

    def __init__(self, nsim: int, n: int, *, damping: float, period: float = 1e-3) -> None:
        """Start without compensation.

        Args:
            nsim: number of arms N.
            n: joints of each.
            damping: λ of J^# [m and rad].
            period: time between the controller's cycles [s].
        """
        self.n = n
        self.arrays = Compensations(
            damping=damping,
            period=period,
            kind=np.full(nsim, -1),
            feeds=np.zeros(nsim, dtype=bool),
            reads_model=np.zeros(nsim, dtype=bool),
            numbers=np.zeros((nsim, n, _MOST)),
            state=np.zeros((nsim, n, 1)),
            last_speed=np.zeros((nsim, n)),
            wanted_speed=np.zeros((nsim, n)),
            gravity=np.zeros((nsim, n)),
            coriolis=np.zeros((nsim, n)),
            torque=np.zeros((nsim, n)),
        )
        """Arrays that compiled functions read and write; always the same objects."""

    def set_rows(self, ids: Index, compensations: Sequence[Compensation | None]) -> None:
        """Set the compensation of arms ``ids``; None switches it off. Observers start anew."""
        a = self.arrays
        for i, c in zip(ids, compensations, strict=True):
            if c is not None and c.n != self.n:
                raise StictionError(f"compensation of {c.n} joints: expected {self.n}")
            used = c is not None and any(c.gain)
            a.kind[i] = KINDS.index(c.kind) if c is not None and used else -1
            a.feeds[i] = c is not None and used and LAWS[c.kind].feeds
            a.reads_model[i] = c is not None and used and LAWS[c.kind].reads_model(vars(c))
            a.numbers[i] = c.packed() if c is not None else 0.0
        self.reset(ids)

    def reset(self, ids: Index) -> None:
        """Let arms ``ids`` start at rest: observers have seen nothing."""
        for array in (self.arrays.state, self.arrays.last_speed, self.arrays.torque):
            array[ids] = 0.0


@compiled
def look_ahead(i: int, jacobian: Array, twist: Array, a: Compensations) -> None:
    """Write q̇_d of arm ``i`` from its Jacobian (6, n) and the reference's twist (6,)
    [m/s, rad/s]."""
    damped = jacobian @ jacobian.T + a.damping**2 * np.eye(6)
    a.wanted_speed[i] = jacobian.T @ np.linalg.solve(damped, twist)


@compiled
def compensate(
    i: int,
    position: Array,
    quaternion: Array,
    jacobian: Array,
    dq: Array,
    mass: Array,
    impedance: Impedance,
    a: Compensations,
) -> None:
    """Write the compensation of arm ``i`` from what its controller has measured.

    ``mass`` (N, n, n) is that of the controller's model, rotors included [kg·m²]; the impedance
    controllers have the torque of the last cycle. Other arrays are those of `impedance_cycle`.
    """
    n, law, torque = dq.shape[1], a.kind[i], a.torque
    for j in range(n):
        torque[i, j] = 0.0
    if law < 0:
        return
    error, wrench, seen = np.empty(6), np.zeros(6), np.zeros(SEEN)
    gain, command = impedance.gain, impedance.command
    if _READS_ERROR[law]:
        reference = impedance.position[i], impedance.error_matrix[i]
        pose_error(position[i], quaternion[i], reference[0], reference[1], error)
        for k in range(6):
            for m in range(6):
                wrench[k] += gain[i, k, m] * error[m]
    for j in range(n):
        if a.numbers[i, j, 0] <= 0.0:
            continue
        seen[WANTED_SPEED], seen[SPEED] = a.wanted_speed[i, j], dq[i, j]
        if _READS_ERROR[law]:
            pull, stiffness = 0.0, 0.0
            for k in range(6):
                pull += jacobian[i, k, j] * wrench[k]
                for m in range(6):
                    stiffness -= jacobian[i, k, j] * gain[i, k, m] * jacobian[i, m, j]
            # a joint that the impedance does not hold has no error
            seen[ERROR] = pull / stiffness if stiffness > 0.0 else 0.0
        seen[GRAVITY], seen[TORQUE] = a.gravity[i, j], command[i, j] - a.coriolis[i, j]
        if _READS_MOMENTUM[law]:
            gained = 0.0
            for m in range(n):
                gained += mass[i, j, m] * (dq[i, m] - a.last_speed[i, m])
            seen[PUSHED] = gained
        torque[i, j] = law_torque(law, a.numbers[i, j], seen, a.state[i, j], a.period)
    for j in range(n):
        a.last_speed[i, j] = dq[i, j]
