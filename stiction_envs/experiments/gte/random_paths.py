"""Numbered random paths: number k of an arm is always the same path.

A policy that is trained on two paths memorises them. Path k has three to six goals in a flat,
sloping box around the start; its size, slope, pace and stiffness are drawn by a generator of its
own, whose seed is k. A path that the arm cannot follow is drawn again: the inverse kinematics, from
point to point, must reach every point of every line, far from joint limits and singular poses.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path as File

import mujoco
import numpy as np
from mujoco.batch import Batch

from stiction_envs.arrays import Array, Bools
from stiction_envs.control.kinematics import EndEffector
from stiction_envs.control.rotation import rotation_error
from stiction_envs.control.trajectory import Path
from stiction_envs.errors import StictionError
from stiction_envs.friction.model import StickingModel
from stiction_envs.method_settings import Count, Positive, Share, load_settings
from stiction_envs.precomputed import store

RANDOM = "random"
KIND = "random_paths"


@dataclass(frozen=True, kw_only=True)
class RandomPathSettings:
    """Settings of random paths, and limits that an arm can follow; `gte.toml` has the sources."""

    fewest_goals: Count  # Least number of goals of a path
    most_goals: Count  # Largest number of goals of a path
    smallest: Positive  # Half the length of the box [m]
    largest: Positive  # Half the length of the box [m]
    flatness: Share  # Height of the box over its length [-]
    steepest: Positive  # Largest slope of the box [rad]
    shortest_side: Share  # Least distance of two goals over half the box's length [-]
    slowest: Share  # Least pace [-]
    stiffness_translation: Positive  # The least [N/m]
    stiffness_rotation: Positive  # The least [N·m/rad]
    stiffness_range: Positive  # Largest stiffness over the least [-]
    limit_margin: Positive  # Distance of the joints from their limits [rad]
    least_dexterity: Share  # Smallest singular value of the Jacobian over that at the start [-]
    length: Positive  # How much translation a turn of 1 rad counts as [m]
    out_of_reach: Positive  # What the inverse kinematics may miss by [m]
    step: Positive  # Between two points of a line that are checked [m]
    damping: Positive  # Damping of the inverse kinematics [m]
    attempts: Count  # Most draws of one path; after them the arm can follow none


def random_path_settings() -> RandomPathSettings:
    """Return the defaults."""
    return load_settings(RandomPathSettings, File(__file__).with_name("gte.toml"), "random_paths")


@dataclass(frozen=True, kw_only=True, eq=False)
class RandomPath:
    """A path with the stiffness at which it is followed."""

    path: Path
    stiffness: tuple[float, float, float]  # Translational [N/m], rotational and nullspace [N·m/rad]


def path_number(name: str) -> int | None:
    """Return the number of a random path's name (``random-17``), None for another name."""
    head, _, number = name.partition("-")
    return int(number) if head == RANDOM and number.isdecimal() else None


def random_paths(
    sticking: StickingModel, start: Array, tool: Array, numbers: Iterable[int]
) -> dict[int, RandomPath]:
    """Return the random paths of an arm by number (from 0); paths are independent of each other.

    Args:
        sticking: the arm; friction and payload make no difference.
        start: (n,) joint angles at which paths begin [rad].
        tool: (3,) the point that follows them, from the flange in the hand's frame [m].
        numbers: from 0.

    Raises:
        StictionError: a number below 0, or an arm that can follow none of the paths drawn for one.
    """
    s = random_path_settings()
    wanted = sorted(set(numbers))
    if wanted and wanted[0] < 0:
        raise StictionError(f"random path {wanted[0]}: expected a whole number from 0")
    of = fingerprint(sticking, start, tool)
    known = store.recall(KIND, of)
    found = {}
    for k in wanted:
        if (attempt := known.get(str(k))) is not None:
            rng = np.random.default_rng(k)
            found[k] = [_draw(k, rng, s) for _ in range(int(attempt))][-1]
    new = _search(sticking, start, tool, [k for k in wanted if k not in found], s)
    if new:
        store.keep(KIND, of, {str(k): attempt for k, (attempt, _) in new.items()})
    found |= {k: path for k, (_, path) in new.items()}
    return {k: found[k] for k in wanted}


def fingerprint(sticking: StickingModel, start: Array, tool: Array) -> str:
    """Return a hash of everything that the paths of an arm depend on; see `random_paths`."""
    return store.digest(sticking.arm.fingerprint, start, tool, random_path_settings())


def _search(
    sticking: StickingModel,
    start: Array,
    tool: Array,
    numbers: Sequence[int],
    s: RandomPathSettings,
) -> dict[int, tuple[int, RandomPath]]:
    """Return the first path of each number that the arm can follow, and which draw it was."""
    generators = {k: np.random.default_rng(k) for k in numbers}
    found: dict[int, tuple[int, RandomPath]] = {}
    for attempt in range(1, s.attempts + 1):
        left = [k for k in numbers if k not in found]
        if not left:
            break
        drawn = [_draw(k, generators[k], s) for k in left]
        good = can_follow(sticking, start, tool, [d.path for d in drawn], s)
        found |= {k: (attempt, d) for k, d, ok in zip(left, drawn, good, strict=True) if ok}
    for k in numbers:
        if k not in found:
            raise StictionError(
                f"random path {k}: {sticking.arm.name} can follow none of {s.attempts} drawn "
                "around its start: expected a start in the middle of its workspace"
            )
    return found


def _draw(k: int, rng: np.random.Generator, s: RandomPathSettings) -> RandomPath:
    """Return the next draw of path ``k``, the same for every arm."""
    count = int(rng.integers(s.fewest_goals, s.most_goals + 1))
    size = s.smallest * (s.largest / s.smallest) ** rng.uniform()
    slope, azimuth = rng.uniform(0.0, s.steepest), rng.uniform(0.0, 2.0 * np.pi)
    pace = rng.uniform(s.slowest, 1.0)
    stiffer = s.stiffness_range ** rng.uniform()
    goals = [np.zeros(3)]
    while len(goals) <= count:
        goal = size * np.array([1.0, 1.0, s.flatness]) * rng.uniform(-1.0, 1.0, size=3)
        if np.sqrt(np.sum((goal - goals[-1]) ** 2)) >= s.shortest_side * size:
            goals.append(goal)
    c, d = np.cos(azimuth), np.sin(azimuth)
    about_z = np.array([[c, -d, 0.0], [d, c, 0.0], [0.0, 0.0, 1.0]])
    c, d = np.cos(slope), np.sin(slope)
    about_y = np.array([[c, 0.0, d], [0.0, 1.0, 0.0], [-d, 0.0, c]])
    position = np.array([about_z @ (about_y @ goal) for goal in goals[1:]])
    straight = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    return RandomPath(
        path=Path(f"{RANDOM}-{k}", position, straight, pace),
        stiffness=(s.stiffness_translation * stiffer, s.stiffness_rotation * stiffer, 0.0),
    )


def can_follow(
    sticking: StickingModel, start: Array, tool: Array, paths: Sequence[Path], s: RandomPathSettings
) -> Bools:
    """Return which paths (P,) of constant orientation an arm can follow from its start.

    From point to point of every line the joint angles take steps of damped least squares towards
    the next pose, as an arm without nullspace stiffness does. See `random_paths`.
    """
    offsets = [_points(path, s.step) for path in paths]
    longest = max(len(o) for o in offsets)
    # a path that is over stays at its last goal
    along = np.stack([o[np.minimum(np.arange(longest), len(o) - 1)] for o in offsets], axis=1)
    nsim, low, high = len(paths), *sticking.arm.limits.position.T
    batch = Batch(sticking.model, nsim, 1)
    hand, qpos = EndEffector(sticking, batch, tool), batch.bind("qpos")
    qpos[:] = 0.0
    q, good = np.tile(start, (nsim, 1)), np.ones(nsim, dtype=bool)
    unit = np.array([1.0, 1.0, 1.0, s.length, s.length, s.length])

    def look() -> tuple[Array, Array]:
        qpos[:, sticking.motor] = q
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS)
        hand.read()
        scaled = unit[:, None] * hand.jacobian
        smallest = np.linalg.svd(scaled, compute_uv=False)[:, -1]
        return scaled, np.asarray(smallest, dtype=np.float64)

    scaled, least = look()
    origin, upright = hand.position.copy(), hand.quaternion.copy()
    bound = s.least_dexterity * least
    for offset in along:
        for _ in range(2):
            lag = np.concatenate(
                [origin + offset - hand.position, rotation_error(upright, hand.quaternion)], axis=1
            )
            square = scaled @ scaled.transpose(0, 2, 1) + s.damping**2 * np.eye(6)
            step = np.linalg.solve(square, (unit * lag)[..., None])
            q = np.clip(q + (scaled.transpose(0, 2, 1) @ step)[..., 0], low, high)
            scaled, least = look()
        missed = np.sqrt(((origin + offset - hand.position) ** 2).sum(axis=1))
        good &= missed <= s.out_of_reach
        good &= ((q >= low + s.limit_margin) & (q <= high - s.limit_margin)).all(axis=1)
        good &= (least >= bound) | (sticking.n < 6)
    return good


def _points(path: Path, step: float) -> Array:
    """Return points (P, 3) of a path's lines, at most ``step`` apart, from the start [m]."""
    ends = np.concatenate([np.zeros((1, 3)), path.position])
    parts = []
    for a, b in pairwise(ends):
        count = max(1, int(np.ceil(np.sqrt(np.sum((b - a) ** 2)) / step)))
        parts.append(a + np.arange(1, count + 1)[:, None] / count * (b - a))
    return np.concatenate(parts)
