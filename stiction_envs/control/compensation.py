"""Friction compensation, the usual alternative to dither: gains, their files, N arms.

The laws are in `laws`, a file each. What they may use is what a controller has: measured angles and
speeds, the reference, its own model of the arm's dynamics, and the torque that it commanded.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.compiled import compiled
from stiction_envs.control.impedance import Impedance, pose_error
from stiction_envs.control.laws import LAWS, Law
from stiction_envs.control.laws.base import (
    ERROR,
    GAIN,
    GRAVITY,
    PUSHED,
    SEEN,
    SPEED,
    TORQUE,
    WANTED_SPEED,
    law_torque,
)
from stiction_envs.errors import StictionError, checked_array, unknown
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.method_settings import Amount, checked


def law_named(kind: str) -> Law:
    """Return a law; raise a StictionError for an unknown name."""
    if kind not in LAWS:
        raise unknown("compensation", kind, LAWS)
    return LAWS[kind]


@dataclass(frozen=True, init=False)
class Compensation:
    """Friction compensation of the n joints of one arm by one of the `laws`."""

    kind: str  # Name of the law
    gain: tuple[float, ...]  # (n,) >= 0 [N·m]; a joint with gain 0 is not compensated
    numbers: Mapping[str, tuple[float, ...]] = field(hash=False)
    """Values (n,) of the law's `fields` by their names."""

    def __init__(self, *, kind: str, gain: ArrayLike, **numbers: ArrayLike) -> None:
        """Take the gain and the law's numbers, one per joint or one for all.

        A number that is not given has the law's default.
        """
        law = law_named(kind)
        expected = "finite numbers, one number per joint [N·m]"
        shape = checked_array(gain, "compensation gain", expected=expected).shape
        if len(shape) != 1 or not shape[0]:
            raise StictionError(f"compensation gain: expected {expected}")
        names = [field.name for field in law.fields]
        for name in numbers:
            if name not in names:
                expected = ", ".join(names)
                raise StictionError(f"compensation {name}: {kind} has none: expected {expected}")
        out = {}
        for own in (GAIN, *law.fields):
            given = gain if own is GAIN else numbers.get(own.name, own.default)
            if given is None:
                raise StictionError(f"compensation {own.name}: {kind} needs it [{own.unit}]")
            expected = f"one number, or {shape[0]} [{own.unit}]"
            values = checked_array(
                given, f"compensation {own.name}", shape, expected=expected, fill=True
            )
            bad = (values <= 0 if own.positive else values < 0) | (values > own.largest)
            for j in np.flatnonzero(bad):
                raise StictionError(
                    f"compensation {own.name} of joint {j + 1} is {values[j]:g}: "
                    f"expected {own.expected}"
                )
            out[own.name] = tuple(map(float, values))
        object.__setattr__(self, "kind", kind)
        object.__setattr__(self, "gain", out.pop(GAIN.name))
        object.__setattr__(self, "numbers", out)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.gain)

    def packed(self) -> Array:
        """Return (n, K) numbers as the compiled law takes them."""
        values = [np.array(self.numbers[field.name]) for field in LAWS[self.kind].fields]
        fields = zip(values, LAWS[self.kind].fields, strict=True)
        return np.column_stack([self.gain, *(1.0 / x if f.inverse else x for x, f in fields)])

    def replace(self, **changes: ArrayLike) -> "Compensation":
        """Return the compensation with other numbers."""
        numbers: dict[str, ArrayLike] = {"gain": self.gain, **self.numbers, **changes}
        return Compensation(kind=self.kind, **numbers)

    def times(self, factor: float) -> "Compensation":
        """Return the compensation of ``factor`` times as much friction; raise for a factor < 0."""
        if checked(factor, Amount, "compensation factor") == 0:  # no friction at all has no bristle
            return self.replace(gain=(0.0,) * self.n)
        scaled = {f.name: self.numbers[f.name] for f in LAWS[self.kind].fields if f.scales}
        scaled["gain"] = self.gain
        return self.replace(**{name: factor * np.array(x) for name, x in scaled.items()})

    @classmethod
    def from_friction(
        cls, kind: str, friction: FrictionParameters, factor: float = 1.0, *, load: ArrayLike = 0.0
    ) -> "Compensation":
        """Return the compensation that takes the friction of one arm for true, directions averaged.

        ``factor`` multiplies the friction [-]; ``load`` (n,) is the transmitted torque [N·m].
        """
        gains = law_named(kind).gains(friction, np.broadcast_to(load, friction.n))
        return cls(kind=kind, **gains).times(factor)


class Compensations(NamedTuple):
    """Compensation of N arms of n joints."""

    damping: float  # λ of J^# [m and rad]
    period: float  # Period of the controller's cycles [s]
    law: Index  # (N,) address of the law's compiled torque, 0 for none
    feeds: Bools  # (N,) whether the law reads `wanted_speed`
    reads_error: Bools  # (N,)
    reads_momentum: Bools  # (N,)
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
            law=np.zeros(nsim, dtype=np.int64),
            feeds=np.zeros(nsim, dtype=bool),
            reads_error=np.zeros(nsim, dtype=bool),
            reads_momentum=np.zeros(nsim, dtype=bool),
            reads_model=np.zeros(nsim, dtype=bool),
            numbers=np.zeros((nsim, n, 1 + max(len(law.fields) for law in LAWS.values()))),
            state=np.zeros((nsim, n, 1)),
            last_speed=np.zeros((nsim, n)),
            wanted_speed=np.zeros((nsim, n)),
            gravity=np.zeros((nsim, n)),
            coriolis=np.zeros((nsim, n)),
            torque=np.zeros((nsim, n)),
        )
        """Arrays that compiled functions read and write; always the same objects."""
        self._kinds = [""] * nsim

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Write the addresses of this process."""
        vars(self).update(state)
        for i, kind in enumerate(self._kinds):
            self.arrays.law[i] = LAWS[kind].code.address if kind else 0

    def set_rows(self, ids: Index, compensations: Sequence[Compensation | None]) -> None:
        """Set the compensation of arms ``ids``; None switches it off. Observers start anew."""
        a = self.arrays
        flags = a.feeds, a.reads_error, a.reads_momentum, a.reads_model
        for array in (a.law, *flags, a.numbers):
            array[ids] = 0
        for i, c in zip(ids, compensations, strict=True):
            if c is not None and c.n != self.n:
                raise StictionError(f"compensation of {c.n} joints: expected {self.n}")
            self._kinds[i] = c.kind if c is not None and any(c.gain) else ""
            if c is None or not self._kinds[i]:
                continue
            law, packed = LAWS[c.kind], c.packed()
            a.law[i], a.numbers[i, :, : packed.shape[1]] = law.code.address, packed
            a.feeds[i], a.reads_error[i] = law.feeds, law.reads_error
            a.reads_momentum[i], a.reads_model[i] = law.reads_momentum, law.reads_model(c.numbers)
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
    n, law, torque = dq.shape[1], a.law[i], a.torque
    for j in range(n):
        torque[i, j] = 0.0
    if law == 0:
        return
    reads_error, reads_momentum = a.reads_error[i], a.reads_momentum[i]
    error, wrench, seen = np.empty(6), np.zeros(6), np.zeros(SEEN)
    gain, command = impedance.gain, impedance.command
    if reads_error:
        reference = impedance.position[i], impedance.error_matrix[i]
        pose_error(position[i], quaternion[i], reference[0], reference[1], error)
        for k in range(6):
            for m in range(6):
                wrench[k] += gain[i, k, m] * error[m]
    for j in range(n):
        if a.numbers[i, j, 0] <= 0.0:
            continue
        seen[WANTED_SPEED], seen[SPEED] = a.wanted_speed[i, j], dq[i, j]
        if reads_error:
            pull, stiffness = 0.0, 0.0
            for k in range(6):
                pull += jacobian[i, k, j] * wrench[k]
                for m in range(6):
                    stiffness -= jacobian[i, k, j] * gain[i, k, m] * jacobian[i, m, j]
            # a joint that the impedance does not hold has no error
            seen[ERROR] = pull / stiffness if stiffness > 0.0 else 0.0
        seen[GRAVITY], seen[TORQUE] = a.gravity[i, j], command[i, j] - a.coriolis[i, j]
        if reads_momentum:
            gained = 0.0
            for m in range(n):
                gained += mass[i, j, m] * (dq[i, m] - a.last_speed[i, m])
            seen[PUSHED] = gained
        numbers, state = a.numbers[i, j].ctypes.data, a.state[i, j].ctypes.data
        torque[i, j] = law_torque(law, numbers, seen.ctypes.data, state, a.period)
    for j in range(n):
        a.last_speed[i, j] = dq[i, j]
