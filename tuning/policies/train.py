"""Training of a policy that continues after an interruption with the same bits.

    task = Task(robot="panda", experiment="gte")
    with OutputFolder(path, provenance(...), resumable=True) as folder:
        trained = train(task, "ppo", steps=300_000, out=folder.path)

The steps are: evaluate, then rollouts with evaluations and checkpoints between them, evaluate, keep
the policy of the best evaluation. All random numbers follow from the seed; interruptions do not
change them. Needs the extra `rl`.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.agents import ConstantTable
from stiction_envs.errors import StictionError
from stiction_envs.experiments.actions import DITHERED
from stiction_envs.measured import AmplitudeRow
from stiction_envs.method_settings import fingerprint
from stiction_envs.reporting.atomic import write_bytes_atomic
from tuning.policies.algorithms import (
    Settings,
    begin_with,
    export,
    least_steps,
    make_env,
    make_logger,
    make_model,
    packages,
    settings_of,
)
from tuning.policies.checkpoint import newest, read_state, restore, save
from tuning.policies.policy import Policy
from tuning.policies.settings import PolicySettings, policy_settings
from tuning.policies.task import Task
from tuning.policies.training_callbacks import Checkpoints, CurvePoint, Evaluations, write_curve

CHECKPOINTS, POLICY, CURVE = "checkpoint", "policy.zip", "curve.csv"
"""Contents of the folder of a training."""
NO_TENSORBOARD = f"tensorboard is not installed: the curve is in {CURVE} alone"
Progress = Callable[[str, float], None]
"""Called with a stage and the finished share of the training."""


@dataclass(frozen=True, kw_only=True)
class Trained:
    """Result of a training."""

    policy: Policy
    """Policy of the best evaluation."""
    points: tuple[CurvePoint, ...]
    """The curve."""
    resumed_at: int | None
    """Steps of the checkpoint from which it continued, None for none."""
    steps_per_second: float | None
    """Speed of this process without evaluations; None if nothing was left to train."""
    notes: tuple[str, ...]
    """Notes for the user."""

    @property
    def best(self) -> CurvePoint:
        """The evaluation whose policy was saved."""
        return max(self.points, key=lambda p: p.evaluation_return)


@dataclass(frozen=True, kw_only=True)
class Training:
    """Definition of a training; equal ones give the same bits."""

    task: Task
    algorithm: str
    """One of `algorithms.ALGORITHMS`."""
    steps: int
    """Steps of all arms together; the last rollout may exceed it."""
    seed: int = 0
    """Seed of all random numbers."""
    start: Sequence[AmplitudeRow] = ()
    """Amplitudes that the policy starts with."""
    settings: PolicySettings

    @property
    def own(self) -> Settings:
        """Settings of the algorithm."""
        return settings_of(self.algorithm, self.settings)

    @property
    def starts(self) -> bool:
        """Whether it starts from dither or gains that are known."""
        return bool(self.start) or self.task.arguments.get("action", DITHERED) != DITHERED

    def identity(self) -> dict[str, object]:
        """Return what distinguishes a training from another."""
        task, settings = self.task, self.settings
        return {
            "robot": task.arm_name,
            "environment": task.kind,
            "algorithm": self.algorithm,
            "steps": self.steps,
            "seed": self.seed,
            "start": [repr(row) for row in self.start],
            "arguments": {k: repr(v) for k, v in sorted(task.arguments.items())},
            "settings": fingerprint({"own": self.own, "run": settings.run}),
            "start_settings": fingerprint(settings.start) if self.starts else None,
            "packages": packages(),
        }

    def check(self, out: Path | None) -> None:
        """Raise a StictionError if the arguments are invalid; nothing is written.

        ``out`` is searched for a checkpoint; None for a new training.
        """
        least, why = least_steps(self.own)
        if self.steps < least:
            raise StictionError(f"{self.steps} steps: expected at least {least}: {why}")
        if out is not None and (place := newest(out / CHECKPOINTS)) is not None:
            read_state(place, self.identity())
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
        """Train in an existing folder; an unfinished run of the same training is continued."""
        return _Process(self, out, progress).run()


def train(
    task: Task,
    algorithm: str,
    *,
    steps: int,
    out: Path,
    seed: int = 0,
    start: Sequence[AmplitudeRow] = (),
    settings: PolicySettings | None = None,
    progress: Progress | None = None,
) -> Trained:
    """Train; ``policy.zip`` and ``curve.csv`` are in the folder from the start on.

    Args:
        task: the environment.
        algorithm: one of `algorithms.ALGORITHMS`.
        steps: steps of all arms together; the last rollout may exceed it.
        out: an existing folder; an unfinished run of the same training in it is continued.
        seed: seed of all random numbers.
        start: amplitudes that the policy starts with, for every observation; their gates are
            ignored. None: half of the highest amplitudes and frequencies; with an action that has
            more than dither no dither, and the gains of the environment's treatment.
        settings: None for the defaults.
        progress: see `Progress`.

    Raises:
        StictionError: an unknown algorithm, too few steps, a checkpoint of another training, a
            table that the environment cannot execute.
    """
    settings = policy_settings() if settings is None else settings
    training = Training(
        task=task, algorithm=algorithm, steps=steps, seed=seed, start=start, settings=settings
    )
    training.check(out)
    return training.run(out, progress)


class _Process:
    """The part of a training that one process runs."""

    def __init__(self, training: Training, out: Path, progress: Progress | None) -> None:
        self._training, self._out, self._progress = training, out, progress
        self._identity = training.identity()
        own, run = training.own, training.settings.run
        task, seed = training.task, training.seed
        env = make_env(task, own.envs, run, own.gamma)
        self._model = make_model(own, env, seed)
        if training.starts:
            action = first_action(task, training.start)
            begin_with(self._model, action, training.settings.start)
        self._evaluations = Evaluations(
            make_env(task, run.evaluation_episodes, run, own.gamma),
            seed=far_seed(seed, 1),
            every=run.evaluation_every,
            keep_best=self._keep_best,
            say=self._evaluated,
        )
        self._checkpoints = Checkpoints(run.checkpoint_every, self._save, self._say)
        self._said = ""

    def run(self) -> Trained:
        """Train the rest."""
        at, finished = None, False
        if (place := newest(self._out / CHECKPOINTS)) is not None:
            state = read_state(place, self._identity)
            at, finished = int(state["counters"]["num_timesteps"]), bool(state["finished"])
            if not finished:
                restore(place, state, self._model)
            self._evaluations.restore(state["more"])
            # improvements after the checkpoint are found again
            write_bytes_atomic(self._out / POLICY, (place / POLICY).read_bytes())
        rate = None
        if not finished:
            self._log_to(at or 0)
            rate = self._learn()
            self._save(finished=True)
        write_curve(self._out / CURVE, self._evaluations.points)
        return Trained(
            policy=Policy.load(self._out / POLICY),
            points=tuple(self._evaluations.points),
            resumed_at=at,
            steps_per_second=rate,
            notes=() if _has_tensorboard() else (NO_TENSORBOARD,),
        )

    def _learn(self) -> float:
        start, before = time.monotonic(), self._model.num_timesteps
        self._model.learn(
            self._training.steps - before,
            callback=[self._evaluations, self._checkpoints],
            reset_num_timesteps=before == 0,
        )
        seconds = time.monotonic() - start - self._evaluations.seconds
        return (self._model.num_timesteps - before) / seconds

    # ---- while it learns ---------------------------------------------------------------------

    def _keep_best(self) -> None:
        of = self._identity
        shown = {
            "algorithm": of["algorithm"],
            "steps": int(self._model.num_timesteps),
            **{name: of[name] for name in ("seed", "start", "arguments", "settings")},
        }
        export(self._model, self._training.task, shown).save(self._out / POLICY)

    def _save(self, finished: bool = False) -> None:
        more, best = self._evaluations.state(), self._out / POLICY
        save(self._out / CHECKPOINTS, self._model, self._identity, more, best, finished=finished)

    def _evaluated(self, said: str, steps: int) -> None:
        write_curve(self._out / CURVE, self._evaluations.points)
        self._said = said
        self._say(steps)

    def _say(self, steps: int) -> None:
        if self._progress is not None:
            algorithm = self._training.algorithm
            stage = f"{algorithm}: {self._said}" if self._said else algorithm
            self._progress(stage, min(1.0, steps / self._training.steps))

    def _log_to(self, steps: int) -> None:
        """Log to TensorBoard if it is installed."""
        # a folder for each start: logs after the checkpoint of an interrupted one stay separate
        folder = self._out / "tensorboard" / f"from-{steps:09d}" if _has_tensorboard() else None
        self._model.set_logger(make_logger(folder))


def _has_tensorboard() -> bool:
    return importlib.util.find_spec("tensorboard") is not None


def first_action(task: Task, rows: Sequence[AmplitudeRow]) -> NDArray[np.float64]:
    """Return an amplitude table as an action in [-1, 1]; what it has besides dither is 0.

    Without rows it is no dither, at frequencies of 0.

    Raises:
        StictionError: a table that the environment cannot execute.
    """
    env = task.make(1)
    space = env.core.action_space
    table = ConstantTable(env, rows)
    env.close()
    dither = np.concatenate([table.amplitude, table.frequency])
    low, high = space.low[: len(dither)], space.high[: len(dither)]
    action = 2.0 * (dither - low) / (high - low) - 1.0
    if not rows:
        action[table.n :] = 0.0
    return np.append(action, np.zeros(len(space.low) - len(dither)))


def far_seed(seed: int, which: int) -> int:
    """Return a first seed of episodes that is far from the others, and from the training's."""
    return int(np.random.SeedSequence([seed, which]).generate_state(1)[0]) % 2**31
