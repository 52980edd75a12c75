"""What the thesis does not print of its Generated Trajectory Experiment, drawn from a prior.

    drawn = draw(3, seed=0)
    drawn.set_up.start, drawn.refused

``ensemble.toml`` holds the ranges, each with its reason. A set-up is drawn by a generator of its
own; one that the arm cannot follow is refused by a rule (`why_infeasible`) and drawn anew.
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from stiction_envs.control.kinematics import EndEffector
from stiction_envs.control.rotation import from_rotation_vector, multiply, rotation_error
from stiction_envs.control.trajectory import Path as Corners
from stiction_envs.control.trajectory import pentagon, triangle
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.random_paths import can_follow, random_path_settings
from stiction_envs.friction.model import StickingModel
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.measured import thesis_robots
from stiction_envs.method_settings import override
from stiction_envs.robots import load_arm

Array = NDArray[np.float64]
Prior = dict[str, dict[str, Any]]
"""Tables of ``ensemble.toml`` without units and sources."""
(ROBOT,) = thesis_robots("4.11")
REASONS = ("wrist", "dexterity", "limits", "height", "path")
"""Why a set-up is refused: the wrist cannot point the hand so; the start is near a singular pose;
or near a joint limit; the hand would touch the table; a path leaves what the arm can follow."""
_WRIST = slice(4, 7)
_TURNS_OF_WRIST = 30  # Newton steps; five are usual


def prior(changes: Mapping[str, Any] | None = None) -> Prior:
    """Return the ranges that set-ups are drawn from.

    Args:
        changes: other values by dotted name, such as ``run.set_ups``.
    """
    text = Path(__file__).with_name("ensemble.toml").read_text(encoding="utf-8")
    out = {
        table: {name: entry["value"] for name, entry in entries.items()}
        for table, entries in tomllib.loads(text).items()
    }
    for name, value in (changes or {}).items():
        table, _, key = name.partition(".")
        out[table][key] = type(out[table][key])(value)
    return out


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

    def paths(self) -> dict[str, Corners]:
        """Return triangle and pentagon by name."""
        slope = self.triangle_slope if self.triangle_goes == "down" else -self.triangle_slope
        shape = triangle(self.triangle_side, slope)
        return {
            "triangle": _turned(shape, self.triangle_azimuth, self.triangle_turn),
            "pentagon": _turned(
                pentagon(self.pentagon_side), self.pentagon_azimuth, self.pentagon_turn
            ),
        }


def _turned(path: Corners, azimuth: float, turn: str) -> Corners:
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


def draw(number: int, *, seed: int = 0, ranges: Prior | None = None) -> Drawn:
    """Return feasible set-up ``number``; it is the same whatever others are drawn.

    Raises:
        StictionError: none of the draws allowed is feasible.
    """
    of = prior() if ranges is None else ranges
    rng = np.random.default_rng(np.random.SeedSequence([seed, number]))
    refused: Counter[str] = Counter()
    attempts, pointing = of["feasible"]["attempts"], of["feasible"]["pointing"]
    for _ in range(attempts):
        set_up, missed = _draw(rng, of)
        reason = "wrist" if missed > pointing else why_infeasible(set_up, of)
        if not reason:
            return Drawn(set_up=set_up, refused={k: refused[k] for k in REASONS})
        refused[reason] += 1
    raise StictionError(
        f"set-up {number}: none of {attempts} drawn is feasible: expected a prior whose starts and "
        "paths the arm can follow"
    )


def _draw(rng: np.random.Generator, of: Prior) -> tuple[SetUp, float]:
    """Return the next draw, feasible or not, and what its wrist misses the orientation by."""
    start, paths, motion = of["start"], of["paths"], of["motion"]
    offsets, friction = of["offsets"], of["friction"]

    def within(ends: Sequence[float]) -> float:
        return float(rng.uniform(*ends))

    def scaled(ends: Sequence[float]) -> float:
        return float(np.exp(rng.uniform(*np.log(ends))))

    def one(choices: Sequence[Any]) -> Any:
        return choices[int(rng.integers(len(choices)))]

    def session() -> tuple[float, ...]:
        spread = np.repeat([friction["proximal"], friction["wrist"]], [4, 3])
        logs = spread * rng.normal(size=7) + friction["common"] * rng.normal()
        return tuple(np.exp(logs).tolist())

    # the order of these draws decides the set-ups
    arm_joints = [within(start[f"joint_{j}"]) for j in range(1, 5)]
    lean, side = within(start["lean"]), rng.uniform(0.0, 2.0 * np.pi)
    yaw = within(start["yaw"])
    angles, missed = _point_hand(np.array(arm_joints), lean, side, yaw)
    tilt, towards = within(offsets["tilt"]), rng.uniform(0.0, 2.0 * np.pi)
    set_up = SetUp(
        start=tuple(angles.tolist()),
        triangle_side=scaled(paths["triangle_side"]),
        triangle_slope=within(paths["triangle_slope"]),
        triangle_goes=one(paths["triangle_goes"]),
        triangle_azimuth=within(paths["azimuth"]),
        triangle_turn=one(paths["turn"]),
        pentagon_side=scaled(paths["pentagon_side"]),
        pentagon_azimuth=within(paths["azimuth"]),
        pentagon_turn=one(paths["turn"]),
        speed=scaled(motion["speed"]),
        acceleration=scaled(motion["acceleration"]),
        position_tolerance=scaled(motion["position_tolerance"]),
        rotation_tolerance=scaled(motion["rotation_tolerance"]),
        patience=scaled(motion["patience"]),
        tool=one(of["frame"]["tool"]),
        angles=one(of["frame"]["angles"]),
        damping_design=one(of["frame"]["damping_design"]),
        tilt=(float(tilt * np.cos(towards)), float(tilt * np.sin(towards))),
        hand=one(offsets["hand"]),
        offset=within(offsets["offset"]),
        gravity=within(offsets["gravity"]),
        viscous=scaled(friction["viscous"]),
        no_dither=session(),
        dither=session(),
        seed=int(rng.integers(2**32)),
    )
    return set_up, missed


# ---- feasibility ---------------------------------------------------------------------------------


class _Arm:
    """The bare arm's kinematics, for one pose at a time."""

    def __init__(self, tool: float = 0.0) -> None:
        self.sticking = bare_arm()
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


def why_infeasible(set_up: SetUp, ranges: Prior | None = None) -> str:
    """Return why the arm cannot run a set-up, one of `REASONS`; empty where it can.

    Paths are followed by the inverse kinematics of `random_paths.can_follow`: every point is
    reached, no joint comes near a limit, the Jacobian stays far from singular.
    """
    rule = (prior() if ranges is None else ranges)["feasible"]
    arm, start = _Arm(rule["tip"]), np.array(set_up.start)
    low, high = arm.sticking.arm.limits.position.T
    margin = rule["limit_margin"]
    if not ((start >= low + margin) & (start <= high - margin)).all():
        return "limits"
    least = rule["start_dexterity"] * _rest_dexterity(set_up.tool)
    if _Arm(set_up.tool).dexterity(start) < least:
        return "dexterity"
    paths = list(set_up.paths().values())
    lowest = min(float(p.position[:, 2].min()) for p in paths)
    if arm.at(start).position[0, 2] + min(lowest, 0.0) < rule["height"]:
        return "height"
    asked = override(
        random_path_settings(), {"limit_margin": margin, "least_dexterity": rule["dexterity"]}
    )
    tool = np.array([0.0, 0.0, set_up.tool])
    good = can_follow(arm.sticking, start, tool, paths, asked)
    return "" if good.all() else "path"


@cache
def _rest_dexterity(tool: float) -> float:
    return _Arm(tool).dexterity(bare_arm().arm.rest)
