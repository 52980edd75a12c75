"""PPO's rollouts against the environment alone: what training costs besides physics.

python -m benchmarks.policy_throughput

Both step 64 arms with actions from the same distribution, turn by turn, so that whatever else the
machine does meets both. Writes policy_throughput.md beside this file.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from pathlib import Path

import mujoco
import numpy as np

from stiction_envs.reporting.atomic import write_text_atomic
from tuning.policies.algorithms import make_env, make_model
from tuning.policies.extra import torch
from tuning.policies.settings import policy_settings
from tuning.policies.task import Task

HERE = Path(__file__).parent
TARGET = 0.5


class Pair:
    """One environment alone, and another in PPO's hands."""

    def __init__(self, experiment: str, threads: int) -> None:
        settings = policy_settings()
        own, task = settings.ppo, Task(robot="panda", experiment=experiment, nthread=threads)
        self.steps, self.arms = own.rollout, own.envs
        self.alone = task.make(own.envs)
        self.alone.reset(seed=0)
        self._low, self._high = (
            self.alone.single_action_space.low,
            self.alone.single_action_space.high,
        )
        self._rng, self._spread = np.random.default_rng(0), np.exp(own.log_std)
        self.model = make_model(own, make_env(task, own.envs, settings.run, own.gamma), 0)
        _, self._callback = self.model._setup_learn(10**9, None)

    def step_alone(self) -> float:
        """Seconds of a rollout's steps without PPO; actions are drawn beforehand."""
        shape = (self.steps, *self.alone.action_space.shape)
        x = np.clip(self._spread * self._rng.normal(size=shape), -1, 1)
        actions = self._low + 0.5 * (x + 1) * (self._high - self._low)
        start = time.perf_counter()
        for action in actions:
            self.alone.step(action)
        return time.perf_counter() - start

    def roll_out(self) -> float:
        """Seconds of a rollout of PPO, without its update."""
        m = self.model
        start = time.perf_counter()
        m.collect_rollouts(m.env, self._callback, m.rollout_buffer, n_rollout_steps=m.n_steps)
        return time.perf_counter() - start

    def update(self) -> float:
        """Seconds of an update."""
        start = time.perf_counter()
        self.model.train()
        return time.perf_counter() - start


def measure(experiment: str, threads: int, rounds: int) -> tuple[float, float, float, float]:
    """Return steps/s alone, in rollouts, with updates, and the median of the pairs' ratios."""
    torch.set_num_threads(1)
    pair = Pair(experiment, threads)
    found = []
    for k in range(rounds + 1):
        times = pair.step_alone(), pair.roll_out(), pair.update()
        if k:  # the first warms up
            found.append(times)
    alone, rollout, update = np.array(found).T
    steps = pair.steps * pair.arms
    return (
        steps / np.median(alone),
        steps / np.median(rollout),
        steps / np.median(rollout + update),
        float(np.median(alone / rollout)),
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    args = parser.parse_args()
    own = policy_settings().ppo
    lines = [
        "# Throughput of training",
        "",
        "Written by `python -m benchmarks.policy_throughput`. Python "
        f"{platform.python_version()}, MuJoCo {mujoco.__version__}, torch {torch.__version__}, "
        f"{args.threads} threads for the physics and one for torch; Panda, {own.envs} arms, "
        f"rollouts of {own.rollout} steps, medians of {args.rounds} turns. A step is 0.1 s of one "
        "arm. Speeds are of this machine at that moment; compare the ratios.",
        "",
        "| environment | alone [steps/s] | PPO's rollouts [steps/s] | ratio (target "
        f"{TARGET:g}) | rollouts and updates [steps/s] |",
        "|---|---|---|---|---|",
    ]
    for experiment in ("sje", "gte"):
        alone, rollout, whole, ratio = measure(experiment, args.threads, args.rounds)
        word = "met" if ratio >= TARGET else "missed"
        lines.append(
            f"| Panda{experiment.upper()} | {alone:,.0f} | {rollout:,.0f} | {ratio:.2f} {word} | "
            f"{whole:,.0f} |"
        )
    text = "\n".join(lines) + "\n"
    write_text_atomic(HERE / "policy_throughput.md", text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
