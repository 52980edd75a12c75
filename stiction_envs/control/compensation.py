"""Friction compensation, the usual alternative to dither: feedforward and push.

*Feedforward* of the reference's motion:

    τ = g · tanh(q̇_d/v),   q̇_d = J^# ẋ_d,   J^# = Jᵀ (J Jᵀ + λ²)⁻¹

with g the breakaway torque, ẋ_d the twist of the reference and λ the damping of the controller's
own pseudoinverse. It is zero wherever the reference rests, so an error left at a goal stays.
The law is that of i2rt-robotics/i2rt#37, which takes the measured speed; with the desired one
(robotology/gazebo-yarp-plugins#471) it also acts before the joint moves, and cannot chatter.
On the Panda's paths q̇_d has the sign of the joints' speed in 90 to 99 % of all samples in which
they move, except for joint 4 of the triangle; M⁻¹ Jᵀ Λ ẋ_d instead of J^# ẋ_d gives the same.

*Push* acts in the sign of the joint error. It fades with the measured speed, so that it does not
drive a joint that slips (almond-bot/axol#317):

    τ = g · tanh(e_j/w) · exp(−(q̇_j/v)²),   e_j = (Jᵀ K e)_j / (Jᵀ K J)_jj,   e = x_d − x

e_j is the angle by which joint j alone has to turn until the impedance has no torque on it. With
one joint it is the joint's error; with several it has the sign in which the joint's own motion
lowers the potential ½ eᵀ K e. (J^# e does not: a joint that alone breaks free may then move the
wrong way.) At rest the whole push acts on errors far beyond w; within w it is a spring g/w, which
vanishes with the error. A sharp push (w → 0) is a relay: if it exceeds the friction it hunts, since
the robot responds late. The Panda hunts at w = 0.00005 rad from the breakaway torque on; at
0.0005 rad it does not hunt even at four times that torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.compiled import compiled
from stiction_envs.control.kernels import pose_error
from stiction_envs.control.settings import GTE_DEFAULTS
from stiction_envs.errors import StictionError, unknown
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.measured.csv_text import read_lines

Array = NDArray[np.float64]
Index = NDArray[np.int64]
KINDS = ("feedforward", "push")
COLUMNS = ("joint", "gain_nm")
"""Columns of a table of gains, which may also have `OPTIONAL`."""
OPTIONAL = ("speed_rad_s", "error_rad")


@dataclass(frozen=True, kw_only=True)
class Compensation:
    """Friction compensation of the n joints of one arm by the laws of this module.

    Numbers are one per joint, or one for all; ``gte.toml`` has the sources of the defaults.
    """

    kind: str
    """One of :data:`KINDS`."""
    gain: tuple[float, ...]
    """g (n,), ≥ 0 [N·m]."""
    speed: tuple[float, ...] = ()
    """v (n,), > 0 [rad/s]: desired speed at which a feedforward is tanh 1 = 76 % of its gain,
    measured speed at which a push has faded to 1/e. Empty: the default of the kind."""
    error: tuple[float, ...] = ()
    """w (n,), > 0 [rad]: joint error at which a push is 76 % of its gain. Empty: the default."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise unknown("compensation", self.kind, KINDS)
        gain = _numbers("gain", self.gain, None)
        if gain.ndim != 1 or not len(gain):
            raise StictionError("compensation gain: expected one number per joint [N·m]")
        values = {"gain": gain}
        for name in ("speed", "error"):
            given = getattr(self, name)
            value = given if np.size(given) else usual(self.kind, name)
            values[name] = _numbers(name, value, len(gain))
        for name, array in values.items():
            bad = array < 0 if name == "gain" else array <= 0
            if bad.any():
                j = int(np.argmax(bad))
                expected = ">= 0 N·m" if name == "gain" else "> 0"
                raise StictionError(
                    f"compensation {name} of joint {j + 1} is {array[j]:g}: expected {expected}"
                )
            object.__setattr__(self, name, tuple(map(float, array)))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.gain)

    @classmethod
    def from_friction(
        cls,
        kind: str,
        friction: FrictionParameters,
        factor: float = 1.0,
        *,
        load: ArrayLike = 0.0,
    ) -> Compensation:
        """Return the compensation whose gains are the breakaway torques of ``friction``.

        Args:
            kind: one of :data:`KINDS`.
            friction: of one arm; a gain is the mean breakaway torque of both directions.
            factor: multiplies the gains [-].
            load: (n,) transmitted torque at which friction is taken [N·m].

        Raises:
            StictionError: another kind, or a factor that is not ≥ 0.
        """
        if not 0 <= factor < np.inf:
            raise StictionError(f"compensation factor {factor}: expected >= 0")
        breakaway = friction.stiction_at(np.broadcast_to(load, friction.n)).mean(axis=-1)
        return cls(kind=kind, gain=tuple(factor * breakaway))


def usual(kind: str, name: str) -> float:
    """Default ``speed`` [rad/s] or ``error`` [rad] of a kind."""
    if kind not in KINDS:
        raise unknown("compensation", kind, KINDS)
    default = GTE_DEFAULTS["compensation"][f"{kind}_speed" if name == "speed" else "push_error"]
    return float(default)


def read_compensation(path: Path, kind: str, n: int, factor: float = 1.0) -> Compensation:
    """Read a table of gains, ``joint,gain_nm[,speed_rad_s][,error_rad]``; missing joints get none.

    Args:
        path: the file.
        kind: one of :data:`KINDS`.
        n: joints of the arm.
        factor: multiplies the gains [-].

    Raises:
        StictionError: a table that cannot be read, a joint twice, or bad numbers.
    """
    gain = np.zeros(n)
    speed, error = (np.full(n, usual(kind, name)) for name in ("speed", "error"))
    seen: set[int] = set()
    for line in read_lines(path, COLUMNS, OPTIONAL):
        joint = line.whole("joint", 1, n)
        if joint in seen:
            raise line.error(f"joint {joint} is there twice: expected one line per joint")
        seen.add(joint)
        gain[joint - 1] = factor * line.number("gain_nm")
        if gain[joint - 1] < 0:
            raise line.error(f"gain_nm is {line.number('gain_nm'):g}: expected >= 0")
        for column, values in zip(OPTIONAL, (speed, error), strict=True):
            if line.fields.get(column):
                values[joint - 1] = line.number(column)
                if values[joint - 1] <= 0:
                    raise line.error(f"{column} is {values[joint - 1]:g}: expected > 0")
    if not gain.any():
        raise StictionError(f"{path}: compensates no joint: expected a gain_nm above 0")
    return Compensation(kind=kind, gain=tuple(gain), speed=tuple(speed), error=tuple(error))


class Compensator:
    """Compensation of N arms; each arm has its own compensation, or none."""

    def __init__(self, nsim: int, n: int, *, damping: float) -> None:
        """Start without compensation.

        Args:
            nsim: number of arms N.
            n: joints of each.
            damping: λ of J^# [m and rad].
        """
        self.n, self._damping = n, damping
        self._gain, self._rate = np.zeros((2, 2, nsim, n))
        self._width = np.ones((nsim, n))
        self.wanted_speed = np.zeros((nsim, n))
        """(N, n) q̇_d, kept up to date by `look_ahead` [rad/s]."""
        self.torque = np.zeros((nsim, n))
        """(N, n) of the last controller cycle, overwritten by the next [N·m]."""

    def set_rows(self, ids: Index, compensations: Sequence[Compensation | None]) -> None:
        """Set the compensation of arms ``ids``; None switches it off.

        Raises:
            StictionError: a compensation of another number of joints.
        """
        for i, c in zip(ids, compensations, strict=True):
            self._gain[:, i], self.torque[i] = 0.0, 0.0
            if c is None:
                continue
            if c.n != self.n:
                raise StictionError(f"compensation of {c.n} joints: expected {self.n}")
            k = KINDS.index(c.kind)
            self._gain[k, i], self._rate[k, i] = c.gain, 1.0 / np.array(c.speed)
            self._width[i] = 1.0 / np.array(c.error)

    @property
    def active(self) -> bool:
        """Whether any arm is compensated."""
        return bool(self._gain.any())

    @property
    def feeds(self) -> bool:
        """Whether `look_ahead` is needed."""
        return bool(self._gain[0].any())

    def look_ahead(self, jacobian: Array, twist: Array) -> None:
        """Update q̇_d from the Jacobian (N, 6, n) and the reference's twist (N, 6) [m/s, rad/s]."""
        damped = jacobian @ jacobian.transpose(0, 2, 1) + self._damping**2 * np.eye(6)
        pulled = np.linalg.solve(damped, twist[:, :, None])
        self.wanted_speed[:] = (jacobian.transpose(0, 2, 1) @ pulled)[:, :, 0]

    @property
    def arguments(self) -> tuple[Array, Array, Array, Array, Array]:
        """The last five of `compensate`, but for the result."""
        return self._gain, self._rate, self._width, self.wanted_speed, self.torque


@compiled
def compensate(
    position: Array,
    quaternion: Array,
    jacobian: Array,
    dq: Array,
    reference: Array,
    error_matrix: Array,
    impedance: Array,
    gain: Array,
    rate: Array,
    width: Array,
    wanted_speed: Array,
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
        gain: (2, N, n) g by kind [N·m].
        rate: (2, N, n) 1/v by kind [s/rad].
        width: (N, n) 1/w [1/rad].
        wanted_speed: (N, n) q̇_d [rad/s].
        torque: (N, n), written [N·m].
    """
    n = dq.shape[1]
    error, wrench = np.empty(6), np.empty(6)
    for i in range(len(position)):
        pushed = False
        for j in range(n):
            torque[i, j] = 0.0
            if gain[0, i, j] > 0.0:
                torque[i, j] = gain[0, i, j] * np.tanh(wanted_speed[i, j] * rate[0, i, j])
            pushed = pushed or gain[1, i, j] > 0.0
        if not pushed:
            continue
        pose_error(position[i], quaternion[i], reference[i], error_matrix[i], error)
        for k in range(6):
            wrench[k] = 0.0
            for m in range(6):
                wrench[k] += impedance[i, k, m] * error[m]
        for j in range(n):
            if gain[1, i, j] > 0.0:
                pull, stiffness = 0.0, 0.0
                for k in range(6):
                    pull += jacobian[i, k, j] * wrench[k]
                    for m in range(6):
                        stiffness -= jacobian[i, k, j] * impedance[i, k, m] * jacobian[i, m, j]
                # a joint that the impedance does not hold has no error
                if stiffness > 0.0:
                    fade = dq[i, j] * rate[1, i, j]
                    push = np.tanh(pull / stiffness * width[i, j]) * np.exp(-fade * fade)
                    torque[i, j] += gain[1, i, j] * push


def _numbers(name: str, value: Any, n: int | None) -> Array:
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
