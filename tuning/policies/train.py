"""Training of a policy with Stable-Baselines3, which goes on from its last checkpoint.

    task = Task(robot="panda", experiment="gte")
    training = Training(task=task, algorithm="ppo", steps=300_000, settings=policy_settings())
    training.check()
    trained = training.run(folder)

A training that is not interrupted gives the same bits for the same seed. One that was interrupted
loses what came after its last checkpoint, and starts the episodes that were under way again. Needs
the extra `rl`.
"""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.agents import ConstantTable
from stiction_envs.errors import StictionError
from stiction_envs.measured import AmplitudeRow
from stiction_envs.measured.csv_text import write_lines
from tuning.policies.algorithms import (
    BaseAlgorithm,
    begin_with,
    export,
    least_steps,
    load_checkpoint,
    log_to,
    make_env,
    make_model,
    settings_of,
)
from tuning.policies.callbacks import Checkpoints, Evaluations, newest
from tuning.policies.policy import Policy
from tuning.policies.settings import PolicySettings
from tuning.policies.task import Task

CHECKPOINTS, POLICY, CURVE = "checkpoint", "policy.zip", "curve.csv"
"""Contents of the folder of a training."""
Progress = Callable[[str, float], None]
"""Called with a stage and the finished share of the training."""


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """One evaluation, a row of ``curve.csv``."""

    steps: int
    """Steps of all arms together."""
    evaluation_return: float
    """Mean return of the evaluation's episodes, without exploration."""
    evaluation_std: float
    """Standard deviation of these returns."""
    evaluation_length: float
    """Mean length of these episodes [steps]."""


@dataclass(frozen=True, kw_only=True)
class Trained:
    """Result of a training."""

    policy: Policy
    """Policy of the best evaluation."""
    points: tuple[CurvePoint, ...]
    """The curve."""
    resumed_at: int | None
    """Steps of the checkpoint from which it went on, None for none."""

    @property
    def best(self) -> CurvePoint:
        """The evaluation whose policy was saved."""
        return max(self.points, key=lambda p: p.evaluation_return)


@dataclass(frozen=True, kw_only=True)
class Training:
    """Definition of a training."""

    task: Task
    algorithm: str
    """One of `algorithms.ALGORITHMS`."""
    steps: int
    """Steps of all arms together; the last rollout may exceed it."""
    seed: int = 0
    """Seed of all random numbers."""
    start: Sequence[AmplitudeRow] = ()
    """Amplitudes that the policy starts with, for every observation; gates are ignored. Without
    them: half of the highest amplitudes and frequencies."""
    checkpoint_every: int = 20_000
    """Steps between two checkpoints."""
    settings: PolicySettings

    def check(self) -> None:
        """Raise a StictionError if the training cannot be run; nothing is written."""
        least, why = least_steps(settings_of(self.algorithm, self.settings))
        if self.steps < least:
            raise StictionError(f"{self.steps} steps: expected at least {least}: {why}")
        env = self.task.make(1)
        ConstantTable(env, self.start)  # raises if the environment cannot execute it
        drawn, first = getattr(env.core, "random_paths", 0), self.settings.evaluation.test_paths
        env.close()
        if drawn > first:
            raise StictionError(
                f"random_paths {drawn}: expected at most {first}: policies are evaluated on the "
                "others"
            )

    def run(self, out: Path, progress: Progress | None = None) -> Trained:
        """Train, or go on from the last checkpoint in the folder.

        ``policy.zip`` and ``curve.csv`` are there from the first evaluation on.

        Args:
            out: an existing folder; what is in it was made by the same training.
            progress: see `Progress`.
        """
        at = None
        points = _read_curve(out / CURVE)
        if not points or points[-1].steps < self.steps:
            at = self._learn(out, progress)
            points = _read_curve(out / CURVE)
        shutil.rmtree(out / CHECKPOINTS, ignore_errors=True)
        return Trained(policy=Policy.load(out / POLICY), points=points, resumed_at=at)

    def _learn(self, out: Path, progress: Progress | None) -> int | None:
        """Train the rest; return the steps that were done before."""
        own, run = settings_of(self.algorithm, self.settings), self.settings.run
        env = make_env(self.task, own.envs, run, own.gamma)
        place = newest(out / CHECKPOINTS)
        if place is None:
            model = make_model(own, env, self.seed)
            if self.start:
                begin_with(model, first_action(self.task, self.start), self.settings.start)
        else:
            model = load_checkpoint(self.algorithm, place, env)
            # not the episodes and the noise of the beginning once more
            model.set_random_seed(far_seed(self.seed, int(place.name)))
        log_to(model, out / "tensorboard")

        def say(evaluations: Evaluations) -> None:
            if progress is not None:
                words = (
                    f"{self.algorithm}: return {evaluations.last_mean_reward:.3f}, best "
                    f"{evaluations.best_mean_reward:.3f}"
                )
                progress(words, min(1.0, model.num_timesteps / self.steps))

        def evaluated(evaluations: Evaluations) -> None:
            _write_curve(out / CURVE, evaluations)
            if evaluations.improved:
                self._export(model).save(out / POLICY)

        evaluations = Evaluations(
            make_env(self.task, run.evaluation_episodes, run, own.gamma),
            out / CHECKPOINTS,
            seed=far_seed(self.seed, 1),
            every=max(1, run.evaluation_every // own.envs),
            evaluated=evaluated,
            say=say,
        )
        checkpoints = Checkpoints(
            out / CHECKPOINTS,
            every=max(1, self.checkpoint_every // own.envs),
            more=(out / POLICY, evaluations.file),
        )
        if place is not None:
            checkpoints.copy_back(place)
            evaluations.restore()
        before = model.num_timesteps
        model.learn(
            self.steps - before, callback=[evaluations, checkpoints], reset_num_timesteps=not before
        )
        return before or None

    def _export(self, model: BaseAlgorithm) -> Policy:
        described = {
            "algorithm": self.algorithm,
            "steps": int(model.num_timesteps),
            "seed": self.seed,
            "start": [repr(row) for row in self.start],
            "arguments": {k: repr(v) for k, v in sorted(self.task.arguments.items())},
        }
        return export(model, self.task, described)


def first_action(task: Task, rows: Sequence[AmplitudeRow]) -> NDArray[np.float64]:
    """Return an amplitude table as an action in [-1, 1].

    Raises:
        StictionError: a table that the environment cannot execute.
    """
    env = task.make(1)
    space, table = env.core.action_space, ConstantTable(env, rows)
    env.close()
    dither = np.concatenate([table.amplitude, table.frequency])
    return np.asarray(2.0 * (dither - space.low) / (space.high - space.low) - 1.0)


def far_seed(seed: int, which: int) -> int:
    """Return a first seed of episodes that is far from the others, and from the training's."""
    return int(np.random.SeedSequence([seed, which]).generate_state(1)[0]) % 2**31


def _write_curve(path: Path, evaluations: Evaluations) -> None:
    points = [
        CurvePoint(
            steps=steps,
            evaluation_return=float(np.mean(returns)),
            evaluation_std=float(np.std(returns)),
            evaluation_length=float(np.mean(lengths)),
        )
        for steps, returns, lengths in zip(
            evaluations.evaluations_timesteps,
            evaluations.evaluations_results,
            evaluations.evaluations_length,
            strict=True,
        )
    ]
    rows = [asdict(p) for p in points]
    write_lines(path, tuple(rows[0]), [tuple(row.values()) for row in rows])


def _read_curve(path: Path) -> tuple[CurvePoint, ...]:
    """Return the points of a file that `_write_curve` wrote; none if there is no file."""
    if not path.is_file():
        return ()
    with open(path, encoding="utf-8", newline="") as file:
        rows = [{k: float(x) for k, x in row.items()} for row in csv.DictReader(file)]
    return tuple(CurvePoint(steps=int(row.pop("steps")), **row) for row in rows)
