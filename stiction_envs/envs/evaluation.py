"""Evaluation of an agent: a row for each episode, simulated on the native batch.

    env = gym.make_vec("stiction_envs:PandaGTE-v0", num_envs=16)
    rows = evaluate(env, GatedTable(env), seeds=range(50), options={"trajectory": "triangle"})

An agent is anything with Stable-Baselines3's `predict` whose actions are in the units of the
environment. Every agent gets the same episodes; a row is the same bits in a batch of any size.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from stiction_envs.arrays import Array, Bools
from stiction_envs.envs.gym_env import ArmVectorEnv, Observation
from stiction_envs.errors import StictionError
from stiction_envs.experiments.episodes import Options

AnyEnv = gymnasium.Env | VectorEnv
State = tuple[NDArray[np.generic], ...]
Row = dict[str, Any]
"""Numbers and words of an episode, by column."""


class PolicyLike(Protocol):
    """An agent that can be evaluated."""

    def predict(
        self,
        observation: Observation,
        state: State | None = None,
        episode_start: Bools | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.generic], State | None]:
        """Return actions (M, 2n) [N·m, Hz …] for observations (M, observations), and the state."""


def evaluate(
    env: AnyEnv,
    agent: PolicyLike,
    seeds: Sequence[int],
    options: Options | Sequence[Options | None] | None = None,
) -> list[Row]:
    """Return one row per episode, in the order of the seeds; `reset` the environment afterwards.

    All rows have ``seed``, the episode's options (``trajectory`` … or ``joint`` …), ``return``,
    ``steps``, ``terminated`` (1, or 0 for truncated), ``reward_…`` of every term, ``power``, mean
    over steps and joints of (A/A_max)² [-], and ``torque_rate``, root mean square of the dither's
    2πfA [N·m/s]. Rows of the GTE have ``position_left_m`` and ``orientation_left_rad``, mean over
    goals, ``position_resting_m`` and ``orientation_resting_rad`` at the last one, where the arm
    rests, all four ``undithered_…`` as well, ``settling_error`` and ``tracking_error`` over the
    undithered run's [-], ``vibration_moving_mm``, ``vibration_at_rest_mm``,
    ``undithered_vibration_mm`` and ``duration_s``; rows of the SJE ``reduction`` [-],
    ``tau_sje_nm``, ``tau_base_nm``, ``oscillation_mrad`` and ``time_s``. Values that
    a truncated episode does not have are NaN.

    Args:
        env: a `GTEVectorEnv` or `SJEVectorEnv`, of any size and autoreset mode.
        agent: its `predict` gets the observations of the whole batch, also of environments whose
            episode does not count; its state has one row per environment.
        seeds: of the episodes.
        options: of all episodes, or one for each.

    Raises:
        StictionError: another environment, other options, a seed below 0, or an action outside the
            bounds.
    """
    batch = env.unwrapped
    if not isinstance(batch, ArmVectorEnv):
        raise StictionError(
            f"evaluate: {type(batch).__name__}: expected a batch of gym.make_vec of this package"
        )
    if not len(seeds):
        return []
    if min(seeds) < 0:
        raise StictionError(f"evaluate: seed {min(seeds)}: expected whole numbers from 0")
    if options is None or isinstance(options, Mapping):
        options = [options] * len(seeds)
    if len(options) != len(seeds):
        raise StictionError(f"evaluate: {len(options)} options: expected one, or {len(seeds)}")
    batches, core = batch.batches, batch.core
    core.prepare(options)
    count = batch.num_envs
    slots, episode = np.arange(count), np.full(count, -1)
    rows: list[Row] = [{} for _ in seeds]
    sums: dict[str, Array] = {}
    waiting = list(range(len(seeds)))
    start = np.ones(count, dtype=bool)
    state: State | None = None
    going = np.zeros(count, dtype=bool)
    if len(spare := slots[len(seeds) :]):
        # an observation of every arm is needed, so unused ones get an episode too
        rngs = [seeding.np_random(int(seeds[0]))[0] for _ in spare]
        batches.reset(spare, rngs, [options[0]] * len(spare))
    top = core.action_space.high[: core.n].astype(float)
    while waiting or going.any():
        free = np.flatnonzero(~going)[: len(waiting)]
        if len(free):
            episode[free] = [waiting.pop(0) for _ in free]
            rngs = [seeding.np_random(int(seeds[k]))[0] for k in episode[free]]
            batches.reset(free, rngs, [options[k] for k in episode[free]])
            going[free] = start[free] = True
            for total in sums.values():
                total[free] = 0.0
            what = batches.describe(free)
            for i, k in enumerate(episode[free]):
                rows[k] = _begun(int(seeds[k]), {n: values[i] for n, values in what.items()})
        observation = batches.observe(slots)
        actions, state = agent.predict(
            observation, state=state, episode_start=start, deterministic=True
        )
        start[:] = False
        ids = np.flatnonzero(going)
        action = np.asarray(actions, dtype=float)[ids]
        step = batches.step(ids, action)
        a, f = np.split(action, 2, axis=1)
        new = {
            "return": step.reward,
            "steps": 1.0,
            **{f"reward_{name}": step.terms[name] for name in core.terms},
            "power": np.mean((a / top) ** 2, axis=1),
            "torque_rate": np.mean((2 * np.pi * f * a) ** 2, axis=1),
        }
        for name, value in new.items():
            sums.setdefault(name, np.zeros(count))[ids] += value
        over = np.flatnonzero(step.terminated | step.truncated)
        last = batches.last_measures(ids[over]) if len(over) else {}
        for k, m in enumerate(over.tolist()):
            row, mine = rows[episode[ids[m]]], {n: float(x[ids[m]]) for n, x in sums.items()}
            steps = int(mine.pop("steps"))
            mine["power"] /= steps
            mine["torque_rate"] = float(np.sqrt(mine["torque_rate"] / steps))
            row |= {"return": mine.pop("return"), "steps": steps}
            row |= {"terminated": int(step.terminated[m]), **mine}
            measures = {name: values[m] for name, values in step.measures.items()}
            row |= core.columns(measures | {name: values[k] for name, values in last.items()})
        going[ids[over]] = False
    return rows


def _begun(seed: int, what: Row) -> Row:
    """Return the row of an episode that has just begun: its seed and its options."""
    row: Row = {"seed": seed}
    for name, value in what.items():
        if name == "stiffness":
            for part, number in zip(("translation", "rotation", "nullspace"), value, strict=True):
                row[f"stiffness_{part}"] = float(number)
        else:
            row[name] = value.item() if isinstance(value, np.generic) else value
    return row
