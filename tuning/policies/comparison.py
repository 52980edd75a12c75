"""Comparison of policies: the same episodes for each, one row per episode."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.dither.tables import shipped_table
from stiction_envs.envs.agents import AGENTS, GatedTable
from stiction_envs.envs.evaluation import PolicyLike, evaluate
from stiction_envs.envs.gym_env import ArmVectorEnv
from stiction_envs.errors import StictionError
from stiction_envs.measured.csv_text import write_rows
from stiction_envs.measured.tables import read_amplitudes
from stiction_envs.reporting.markdown import aligned, number
from tuning.names import EPISODES, GATED, POLICIES
from tuning.policies.policy import Policy
from tuning.policies.settings import policy_settings
from tuning.policies.task import Task

_TOGETHER = 64  # arms at once: the fastest number (measured)
Array = NDArray[np.floating]
COLUMNS = {
    "return": ("return", 1.0, 3),
    "return_error": ("±", 1.0, 3),
    "reduction": ("reduction", 1.0, 3),
    "position_left_m": ("left [mm]", 1e3, 3),
    "orientation_left_rad": ("[mrad]", 1e3, 3),
    "vibration_moving_mm": ("moving [mm]", 1.0, 3),
    "vibration_at_rest_mm": ("at rest [mm]", 1.0, 3),
    "oscillation_mrad": ("shaking [mrad]", 1.0, 2),
    "power": ("power", 1.0, 3),
}
"""Means that are shown: heading, factor, digits."""


@dataclass(frozen=True, kw_only=True)
class Evaluated:
    """Rows and means of every policy."""

    environment: str
    rows: tuple[dict[str, object], ...]
    """One per policy and episode; `stiction_envs.envs.evaluation.evaluate` explains the columns."""

    def save(self, folder: str | Path) -> None:
        """Write ``evaluation.csv``."""
        write_rows(Path(folder) / "evaluation.csv", self.rows)

    @property
    def policies(self) -> list[str]:
        """Names of the policies, in the order of their evaluation."""
        return list(dict.fromkeys(str(row["policy"]) for row in self.rows))

    def values(self, policy: str, name: str) -> NDArray[np.float64]:
        """Return a column (episodes,) of a policy."""
        return np.array([row[name] for row in self.rows if row["policy"] == policy], dtype=float)

    def summary(self) -> dict[str, dict[str, float]]:
        """Return, per policy, the means of all numbers and the standard error of the return."""
        out: dict[str, dict[str, float]] = {}
        # from the return on; the columns before it describe the episode
        names = list(self.rows[0])
        measures = [n for n in names[names.index("return") + 1 :] if not n.startswith("undithered")]
        for policy in self.policies:
            returns = self.values(policy, "return")
            error = np.std(returns, ddof=1) / np.sqrt(len(returns)) if len(returns) > 1 else np.nan
            out[policy] = {"episodes": len(returns), "return": float(returns.mean())}
            out[policy]["return_error"] = float(error)
            out[policy] |= {n: float(self.values(policy, n).mean()) for n in measures}
        return out

    def to_json(self) -> dict[str, object]:
        """Return the environment and the means."""
        return {"environment": self.environment, "summary": self.summary()}

    def __str__(self) -> str:
        summary = self.summary()
        first = next(iter(summary.values()))
        shown = [(name, *look) for name, look in COLUMNS.items() if name in first]
        header = ["policy", *(heading for _, heading, _, _ in shown)]
        rows = [
            [policy, *(number(means[k] * factor, digits) for k, _, factor, digits in shown)]
            for policy, means in summary.items()
        ]
        return f"{self.environment}, {first['episodes']} episodes\n{aligned(header, rows)}"


def evaluate_all(
    task: Task,
    policies: Sequence[str | tuple[str, PolicyLike]],
    *,
    episodes: int = EPISODES,
    seed: int = 0,
    progress: Callable[[str, float, float], None] | None = None,
) -> Evaluated:
    """Evaluate every policy on the same episodes; random paths are those that no training draws.

    Args:
        task: the environment.
        policies: one of `POLICIES`, a ``policy.zip``, an amplitude table, or a name and an agent.
        episodes: number of episodes of each.
        seed: seed of the first episode; the others have those that follow.
        progress: called with a policy's name, episodes done and episodes in all.
    """
    progress = progress or (lambda *_: None)
    env = task.make(min(episodes, _TOGETHER))
    agents = [(p, read_agent(p, task, env)) if isinstance(p, str) else p for p in policies]
    rows: list[dict[str, object]] = []
    every = range(episodes)
    for name, agent in agents:
        progress(name, 0, episodes)
        found = evaluate(env, agent, [seed + k for k in every], [_held_out(task, k) for k in every])
        rows += [{"policy": name, "episode": k, **row} for k, row in enumerate(found)]
        progress(name, episodes, episodes)
    env.close()
    return Evaluated(environment=task.name, rows=tuple(rows))


def check(task: Task, policies: Sequence[str]) -> None:
    """Raise a StictionError if an evaluation has invalid arguments; nothing is run."""
    if len(set(policies)) < len(policies):
        raise StictionError(f"policies {', '.join(policies)}: expected each once")
    env = task.make(1)
    env.core.check_reset([_held_out(task, 0)])
    for name in policies:
        read_agent(name, task, env)
    env.close()


def read_agent(name: str, task: Task, env: ArmVectorEnv) -> PolicyLike:
    """Return the agent of one of `POLICIES`, a ``policy.zip``, or a table with its gates.

    Raises:
        StictionError: an unknown policy, one for another purpose, or a table that the environment
            cannot execute.
    """
    if name == "gated":
        return best_gated(task.arm_name, env)
    if name in POLICIES:
        return AGENTS[name](env)
    path = Path(name)
    if path.suffix == ".zip":
        policy = Policy.load(path)
        policy.check(
            robot=task.arm_name,
            environment=task.kind,
            observation_names=env.observation_names,
            interval=float(env.core.interval),
        )
        return _WithinBounds(policy, env)
    if path.suffix != ".csv":
        raise StictionError(
            f"unknown policy {name!r}: expected one of {', '.join(POLICIES)}, a policy.zip or an "
            "amplitude table (.csv)"
        )
    return GatedTable(env, path, speed=np.inf)


def best_gated(robot: str, env: ArmVectorEnv) -> GatedTable:
    """Return the best gated table shipped for an arm, clipped to the environment's amplitudes.

    The Panda's is the best of 1600 tables with one common gate (``benchmarks/learning/search.md``).
    An arm without one gets `agents.usual_table` with the default gate.
    """
    path = shipped_table(robot, GATED)
    if path is None:
        return GatedTable(env)
    top = env.unwrapped.core.action_space.high.tolist()
    rows = [
        replace(row, amplitude_nm=min(row.amplitude_nm, top[row.joint - 1]))
        for row in read_amplitudes(path, n_joints=env.unwrapped.core.n)
    ]
    return GatedTable(env, rows, speed=np.inf)


class _WithinBounds:
    """A policy with actions clipped to the bounds of another friction than it was trained with."""

    def __init__(self, policy: Policy, env: ArmVectorEnv) -> None:
        space = env.core.action_space
        self._policy, self._low, self._high = policy, space.low, space.high

    def predict(self, observation: Array, *_: object, **__: object) -> tuple[Array, None]:
        """Return the policy's action, clipped; as the policy it has no memory."""
        action, state = self._policy.predict(observation)
        return np.clip(action, self._low, self._high), state


def _held_out(task: Task, episode: int) -> dict[str, object]:
    """Return the options of an episode: a random path is one that no training draws."""
    fixed = task.arguments.get("fixed_options", {})
    if fixed.get("trajectory") != "random" or "path" in fixed:
        return {}
    return {"path": policy_settings().run.test_paths + episode}
