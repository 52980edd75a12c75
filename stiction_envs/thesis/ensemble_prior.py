"""What the thesis does not print of its Generated Trajectory Experiment, drawn from a prior.

    drawn = draw(3, seed=0)
    drawn.set_up.start, drawn.refused

``ensemble.toml`` holds the ranges, each with its reason. A set-up is drawn by a generator of its
own; one that the arm cannot follow is refused by a rule (`why_infeasible`) and drawn anew.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from stiction_envs.control.kinematics import EndEffector
from stiction_envs.control.rotation import from_rotation_vector, multiply, rotation_error
from stiction_envs.control.trajectory import Path, pentagon, triangle
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.random_paths import can_follow, random_path_settings
from stiction_envs.friction.model import StickingModel
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.method_settings import override
from stiction_envs.robots import load_arm
from stiction_envs.thesis.ensemble_settings import EnsembleSettings, Range, ensemble_settings
from stiction_envs.thesis.gte import ROBOT

Array = NDArray[np.float64]
REASONS = ("wrist", "dexterity", "limits", "height", "path")
"""Why a set-up is refused: the wrist cannot point the hand so; the start is near a singular pose;
or near a joint limit; the hand would touch the table; a path leaves what the arm can follow."""
_WRIST = slice(4, 7)
_TURNS_OF_WRIST = 30  # Newton steps; five are usual


# ---- a set-up ------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class SetUp:
    """One way in which the experiment may have been set up; SI units."""

    start: tuple[float, ...]
    """Joint angles [rad]."""
    triangle_side: float
    triangle_slope: float
    triangle_goes: str
    triangle_azimuth: float
    triangle_turn: str
    pentagon_side: float
    pentagon_azimuth: float
    pentagon_turn: str
    speed: float
    acceleration: float
    position_tolerance: float
    rotation_tolerance: float
    patience: float
    tool: float
    """Of the controlled point from the flange, along the hand [m]."""
    angles: str
    damping_design: str
    tilt: tuple[float, float]
    """Roll and pitch of the base [rad]."""
    hand: str
    offset: float
    gravity: float
    viscous: float
    """These three over the shipped ones [-]."""
    no_dither: tuple[float, ...]
    """Dry friction of each joint in the session without dither, over the shipped one [-]."""
    dither: tuple[float, ...]
    """The same in the session with dither."""
    seed: int
    """Of the scatter of the iterations."""

    def paths(self) -> dict[str, Path]:
        """Return triangle and pentagon by name."""
        slope = self.triangle_slope if self.triangle_goes == "down" else -self.triangle_slope
        shapes = {
            "triangle": triangle(self.triangle_side, slope),
            "pentagon": pentagon(self.pentagon_side),
        }
        angles = {"triangle": self.triangle_azimuth, "pentagon": self.pentagon_azimuth}
        turns = {"triangle": self.triangle_turn, "pentagon": self.pentagon_turn}
        return {k: _turned(p, angles[k], turns[k]) for k, p in shapes.items()}


def _turned(path: Path, azimuth: float, turn: str) -> Path:
    """Return a path turned about the vertical; ``right`` is its mirror image."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    x, y, z = path.position.T
    y = y if turn == "left" else -y
    return dataclasses.replace(path, position=np.stack([c * x - s * y, s * x + c * y, z], axis=1))


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A feasible set-up, and how often each reason refused one before."""

    set_up: SetUp
    refused: dict[str, int]


def draw(number: int, *, seed: int = 0, settings: EnsembleSettings | None = None) -> Drawn:
    """Return feasible set-up ``number``; it is the same whatever others are drawn.

    Raises:
        StictionError: none of the draws allowed is feasible.
    """
    s = ensemble_settings() if settings is None else settings
    rng = np.random.default_rng(np.random.SeedSequence([seed, number]))
    refused: Counter[str] = Counter()
    for _ in range(s.feasible.attempts):
        set_up, missed = _draw(rng, s)
        reason = "wrist" if missed > s.feasible.pointing else why_infeasible(set_up, s)
        if not reason:
            return Drawn(set_up=set_up, refused={k: refused[k] for k in REASONS})
        refused[reason] += 1
    raise StictionError(
        f"set-up {number}: none of {s.feasible.attempts} drawn is feasible: expected a prior whose "
        "starts and paths the arm can follow"
    )


def _draw(rng: np.random.Generator, s: EnsembleSettings) -> tuple[SetUp, float]:
    """Return the next draw, feasible or not, and what its wrist misses the orientation by."""
    start, paths, motion, offsets, friction = s.start, s.paths, s.motion, s.offsets, s.friction

    def within(of: Range) -> float:
        return float(rng.uniform(*of))

    def scaled(of: Range) -> float:
        return float(np.exp(rng.uniform(*np.log(of))))

    def one(of: tuple[Any, ...]) -> Any:
        return of[int(rng.integers(len(of)))]

    def session() -> tuple[float, ...]:
        spread = np.repeat([friction.proximal, friction.wrist], [4, 3])
        logs = spread * rng.normal(size=7) + friction.common * rng.normal()
        return tuple(np.exp(logs).tolist())

    arm_joints = [within(r) for r in (start.joint_1, start.joint_2, start.joint_3, start.joint_4)]
    lean, side, yaw = within(start.lean), rng.uniform(0.0, 2.0 * np.pi), within(start.yaw)
    angles, missed = _point_hand(np.array(arm_joints), lean, side, yaw)
    tilt, towards = within(offsets.tilt), rng.uniform(0.0, 2.0 * np.pi)
    set_up = SetUp(
        start=tuple(angles.tolist()),
        triangle_side=scaled(paths.triangle_side),
        triangle_slope=within(paths.triangle_slope),
        triangle_goes=one(paths.triangle_goes),
        triangle_azimuth=within(paths.azimuth),
        triangle_turn=one(paths.turn),
        pentagon_side=scaled(paths.pentagon_side),
        pentagon_azimuth=within(paths.azimuth),
        pentagon_turn=one(paths.turn),
        speed=scaled(motion.speed),
        acceleration=scaled(motion.acceleration),
        position_tolerance=scaled(motion.position_tolerance),
        rotation_tolerance=scaled(motion.rotation_tolerance),
        patience=scaled(motion.patience),
        tool=one(s.frame.tool),
        angles=one(s.frame.angles),
        damping_design=one(s.frame.damping_design),
        tilt=(float(tilt * np.cos(towards)), float(tilt * np.sin(towards))),
        hand=one(offsets.hand),
        offset=within(offsets.offset),
        gravity=within(offsets.gravity),
        viscous=scaled(friction.viscous),
        no_dither=session(),
        dither=session(),
        seed=int(rng.integers(2**32)),
    )
    return set_up, missed


# ---- feasibility ---------------------------------------------------------------------------------


class _Arm:
    """The bare arm's kinematics, for one pose at a time."""

    def __init__(self, tool: float = 0.0) -> None:
        self.sticking: StickingModel = bare_arm()
        self._batch = Batch(self.sticking.model, 1, 1)
        self._qpos = self._batch.bind("qpos")
        self._qpos[:] = 0.0
        self.hand = EndEffector(self.sticking, self._batch, (0.0, 0.0, tool))

    def at(self, q: Array) -> EndEffector:
        self._qpos[0, self.sticking.motor] = q
        self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
        self.hand.read()
        return self.hand

    def dexterity(self, q: Array) -> float:
        """Return the smallest singular value of the Jacobian, a turn as `random_paths` counts."""
        length = random_path_settings().length
        unit = np.array([1.0, 1.0, 1.0, length, length, length])
        jacobian = unit[:, None] * self.at(q).jacobian[0]
        return float(np.linalg.svd(jacobian, compute_uv=False)[-1])


@cache
def bare_arm() -> StickingModel:
    """Return the arm of Table 4.11 without hand and tilt, with its friction."""
    return sticking_model(load_arm(ROBOT))


def _point_hand(offsets: Array, lean: float, side: float, yaw: float) -> tuple[Array, float]:
    """Return joint angles (7,) whose wrist points the hand as asked, and by how much it misses.

    Args:
        offsets: (4,) joints 1 to 4 from the rest pose [rad].
        lean: angle from straight down [rad].
        side: azimuth of the axis that it leans about [rad].
        yaw: turn about the vertical from the rest pose's [rad].
    """
    arm = _Arm()
    q = np.array(arm.sticking.arm.rest)
    down = arm.at(q).quaternion[0].copy()
    q[:4] += offsets
    turns = np.array([[lean * np.cos(side), lean * np.sin(side), 0.0], [0.0, 0.0, yaw]])
    about = from_rotation_vector(turns)
    wanted = multiply(about[0], multiply(about[1], down))[None]
    missed = np.inf
    for _ in range(_TURNS_OF_WRIST):
        hand = arm.at(q)
        error = rotation_error(wanted, hand.quaternion)[0]
        missed = float(np.sqrt(error @ error))
        if missed < 1e-12:
            break
        jacobian = hand.jacobian[0, 3:, _WRIST]
        square = jacobian @ jacobian.T + 1e-12 * np.eye(3)
        step = jacobian.T @ np.linalg.solve(square, error)
        q[_WRIST] += np.clip(step, -0.5, 0.5)
    return q, missed


def why_infeasible(set_up: SetUp, settings: EnsembleSettings | None = None) -> str:
    """Return why the arm cannot run a set-up, one of `REASONS`; empty where it can.

    Paths are followed by the inverse kinematics of `random_paths.can_follow`: every point is
    reached, no joint comes near a limit, the Jacobian stays far from singular.
    """
    s = ensemble_settings() if settings is None else settings
    rule, arm = s.feasible, _Arm(s.feasible.tip)
    start = np.array(set_up.start)
    low, high = arm.sticking.arm.limits.position.T
    if not ((start >= low + rule.limit_margin) & (start <= high - rule.limit_margin)).all():
        return "limits"
    if _Arm(set_up.tool).dexterity(start) < rule.start_dexterity * _rest_dexterity(set_up.tool):
        return "dexterity"
    paths = list(set_up.paths().values())
    lowest = min(float(p.position[:, 2].min()) for p in paths)
    if arm.at(start).position[0, 2] + min(lowest, 0.0) < rule.height:
        return "height"
    asked = override(
        random_path_settings(),
        {"limit_margin": rule.limit_margin, "least_dexterity": rule.dexterity},
    )
    tool = np.array([0.0, 0.0, set_up.tool])
    good = can_follow(arm.sticking, start, tool, paths, asked)
    return "" if good.all() else "path"


@cache
def _rest_dexterity(tool: float) -> float:
    return _Arm(tool).dexterity(bare_arm().arm.rest)


def joint_speeds(set_up: SetUp) -> Array:
    """Return how fast joints turn (7,) in the middle of the triangle's sides [rad/s].

    Root mean square over horizontal directions, by the least joint speeds at the start pose.
    """
    # from rest to rest at equal acceleration and deceleration
    fastest = min(set_up.speed, np.sqrt(set_up.triangle_side * set_up.acceleration))
    jacobian = _Arm(set_up.tool).at(np.array(set_up.start)).jacobian[0]
    across = np.linalg.pinv(jacobian)[:, :2]
    out: Array = fastest * np.sqrt((across**2).mean(axis=1))
    return out
