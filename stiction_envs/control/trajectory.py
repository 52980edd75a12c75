"""Straight lines between poses with trapezoidal speed, and the experiment's paths made of them.

The trajectory generator of the thesis's package (sources.md 6.2) for N arms at once. A movement
starts from the pose **measured** when its goal is accepted, so the standing error of the arm is
dropped at every corner. Everything works element by element: an arm's reference is the same bits
for any N.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.control.impedance import GTE_DEFAULTS
from stiction_envs.control.rotation import from_rpy, multiply
from stiction_envs.control.trapezoid import Goals, Movement, Reference, plan, sample
from stiction_envs.measured.csv_text import header_of, read_lines
from stiction_envs.method_settings import FinitePositive, Positive, Share, check_fields, checked

POSITION = ("x", "y", "z")
RPY = ("roll", "pitch", "yaw")
QUATERNION = ("qw", "qx", "qy", "qz")
_UNIT = 1e-3  # largest departure of a quaternion's length from 1 in a file [-] (assumed)
_DEFAULT, _SIZES = GTE_DEFAULTS["motion"], GTE_DEFAULTS["path"]


@dataclass(frozen=True, kw_only=True)
class MotionLimits:
    """Speed limits of a reference, and tolerances of a goal; ``gte.toml`` has the sources."""

    translational_speed: FinitePositive = _DEFAULT["translational_speed"]  # [m/s]
    rotational_speed: FinitePositive = _DEFAULT["rotational_speed"]  # [rad/s]
    translational_acceleration: FinitePositive = _DEFAULT["translational_acceleration"]  # [m/s²]
    rotational_acceleration: FinitePositive = _DEFAULT["rotational_acceleration"]  # [rad/s²]
    translational_deceleration: FinitePositive = _DEFAULT["translational_deceleration"]  # [m/s²]
    rotational_deceleration: FinitePositive = _DEFAULT["rotational_deceleration"]  # [rad/s²]
    publish_rate_hz: FinitePositive = _DEFAULT["publish_rate_hz"]  # Rate of new references [Hz]
    position_tolerance: Positive = _DEFAULT["position_tolerance"]
    """Largest distance from a goal that is reached [m]; inf: time alone decides."""
    rotation_tolerance: Positive = _DEFAULT["rotation_tolerance"]  # Angle from a reached goal [rad]
    patience: FinitePositive = _DEFAULT["patience"]  # Longest wait at a goal [s]

    def __post_init__(self) -> None:
        check_fields(self, "motion")


def new_movements(nsim: int, s: MotionLimits) -> Movement:
    """Return the movements of N arms within limits, at rest at the origin until `plan`."""
    still = np.tile([1.0, 0.0, 0.0, 0.0], (nsim, 1))
    return Movement(
        acceleration=np.array([s.translational_acceleration, s.rotational_acceleration], float),
        deceleration=np.array([s.translational_deceleration, s.rotational_deceleration], float),
        speed=np.array([s.translational_speed, s.rotational_speed], float),
        start=np.zeros((nsim, 3)),
        start_q=still.copy(),
        goal=np.zeros((nsim, 3)),
        goal_q=still,
        distance=np.zeros((nsim, 2)),
        rise=np.zeros((nsim, 2)),
        flat=np.zeros((nsim, 2)),
        fall=np.zeros((nsim, 2)),
        pace=np.ones((nsim, 2)),
        direction=np.zeros((nsim, 3)),
        asked=np.ones(nsim),
        duration=np.zeros(nsim),
    )


class GoalSequencer:
    """Goals of N arms, each with its own list: when a goal is accepted, and the reference to it.

    A goal is reached when its movement has ended and the measured pose is within both tolerances,
    or the limits' patience has passed. The next goal is accepted in the same call; its movement
    starts from that measured pose.
    """

    def __init__(self, nsim: int, limits: MotionLimits, capacity: int) -> None:
        """Make N sequencers of at most ``capacity`` goals each; all are finished until `start`."""
        turns = np.zeros((nsim, capacity, 4))
        turns[..., 0] = 1.0
        self.movement = new_movements(nsim, limits)
        self.arrays = Goals(
            near_position=float(limits.position_tolerance),
            near_rotation=float(limits.rotation_tolerance),
            patience=float(limits.patience),
            goal=np.zeros((nsim, capacity, 3)),
            goal_q=turns,
            total=np.zeros(nsim, dtype=np.int64),
            current=np.zeros(nsim, dtype=np.int64),
            accepted=np.full((nsim, capacity), np.nan),
            reached=np.full((nsim, capacity), np.nan),
            begun=np.zeros(nsim),
            due=np.full(nsim, np.inf),
        )
        """Arrays that compiled functions read and write; always the same objects."""

    def start(
        self,
        i: int,
        goal_position: Array,
        goal_quaternion: Array,
        position: Array,
        quaternion: Array,
        pace: float = 1.0,
    ) -> None:
        """Give arm ``i`` its goals (G, 3) [m] and (G, 4), G ≤ capacity; accept the first at time 0.

        The arm's measured pose is (3,) [m], (4,). Movements take 1/pace of their time.
        """
        a, count = self.arrays, len(goal_position)
        a.goal[i, :count], a.goal_q[i, :count] = goal_position, goal_quaternion
        a.total[i], a.current[i] = count, 0
        a.accepted[i] = a.reached[i] = np.nan
        self.movement.asked[i] = pace
        plan(i, position, quaternion, a.goal[i, 0], a.goal_q[i, 0], self.movement)
        a.accepted[i, 0] = a.begun[i] = 0.0
        a.due[i] = self.movement.duration[i]

    def reference(self, t: Array) -> Reference:
        """Return the reference of all arms at times t (N,) [s]."""
        return sample(t - self.arrays.begun, self.movement)

    @property
    def finished(self) -> Bools:
        """(N,) arms that have reached their last goal, or have none."""
        return self.arrays.current == self.arrays.total

    @property
    def ahead(self) -> tuple[Array, Array]:
        """(N, 3) position of the goal an arm is moving to or rests at, and from there to the next
        goal, 0 at the last [m]."""
        rows, last = np.arange(len(self.arrays.total)), np.maximum(self.arrays.total - 1, 0)
        here, there = (
            self.arrays.goal[rows, np.minimum(self.arrays.current + k, last)] for k in (0, 1)
        )
        return here, there - here

    @property
    def goals_left(self) -> Index:
        """(N,) goals that are not reached yet, including the one an arm is moving to."""
        return self.arrays.total - self.arrays.current


@dataclass(frozen=True, eq=False)
class Path:
    """Poses to visit, relative to the pose in which the movement begins."""

    name: str  # Name in results
    position: Array  # (G, 3) in the axes of the base, from the start [m]
    quaternion: Array  # (G, 4) turns about the axes of the base, from the orientation at the start
    pace: float = 1.0  # Speed of all movements over that of the limits, in (0, 1] [-]

    def __post_init__(self) -> None:
        checked(self.pace, Share, f"path {self.name}: pace")

    def goals(self, position: ArrayLike, quaternion: ArrayLike) -> tuple[Array, Array]:
        """Return goals (M, G, 3) [m] and (M, G, 4) for starts (M, 3) [m] and (M, 4)."""
        p, q = np.asarray(position, dtype=float), np.asarray(quaternion, dtype=float)
        turn, start = np.broadcast_arrays(self.quaternion[None], q[:, None])
        return p[:, None] + self.position, multiply(turn, start)


def triangle() -> Path:
    """Return an equilateral triangle in space: forward and right, left, back to the start.

    The side, and the slope of the plane downwards from the base's x, are in ``gte.toml``.
    """
    side, slope = _SIZES["triangle_side"], _SIZES["triangle_slope"]
    forward = side * np.sqrt(0.75)
    x, z = forward * np.cos(slope), -forward * np.sin(slope)
    return _constant("triangle", [[x, -0.5 * side, z], [x, 0.5 * side, z], [0.0, 0.0, 0.0]])


def pentagon() -> Path:
    """Return a regular pentagon in the plane of the base's x and y, back to the start."""
    radius = _SIZES["pentagon_side"] / (2.0 * np.sin(np.pi / 5.0))
    angle = np.pi + 2.0 * np.pi * np.arange(1, 5) / 5.0  # the start is the corner nearest the base
    x, y = radius * (1.0 + np.cos(angle)), radius * np.sin(angle)
    return _constant("pentagon", [*np.stack([x, y, np.zeros(4)], axis=1), np.zeros(3)])


def _constant(name: str, position: Sequence[ArrayLike] | Array) -> Path:
    """Return a path of constant orientation: the thesis names no turns (assumed)."""
    return Path(name, np.array(position), np.tile([1.0, 0.0, 0.0, 0.0], (len(position), 1)))


def read_path(path: str | os.PathLike[str]) -> Path:
    """Read goals relative to the start from a CSV file, one row per goal.

    Columns ``x,y,z`` [m], with ``roll,pitch,yaw`` [rad] (fixed axes, as in ROS) or
    ``qw,qx,qy,qz`` as well where the orientation changes. Raise a StictionError with file, line and
    column for an unreadable file, other columns, or a bad number.
    """
    turns: tuple[str, ...] = ()
    header = header_of(path)
    for columns in (QUATERNION, RPY):
        if any(name in header for name in columns):
            turns = columns
    lines = read_lines(path, (*POSITION, *turns), () if turns else (*RPY, *QUATERNION))
    position = np.array([[line.number(c) for c in POSITION] for line in lines])
    values = np.array([[line.number(c) for c in turns] for line in lines])
    name = os.path.splitext(os.path.basename(path))[0]
    if not turns:
        return _constant(name, position)
    if turns == RPY:
        return Path(name, position, from_rpy(values))
    length = np.sqrt((values * values).sum(axis=1))
    for line, value in zip(lines, length, strict=True):
        if abs(value - 1.0) > _UNIT:
            raise line.error(f"qw,qx,qy,qz have length {value:.6g}: expected 1 within {_UNIT:g}")
    return Path(name, position, values / length[:, None])
