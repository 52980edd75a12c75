"""Training of a policy with Stable-Baselines3, which goes on from its last checkpoint.

A training that is not interrupted gives the same bits for the same seed. One that was interrupted
loses what came after its last checkpoint, and starts the episodes that were under way again. Needs
the extra `rl`.
"""

import os
import shutil
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from stiction_envs.envs.registration import EXPERIMENTS
from stiction_envs.errors import StictionError
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.atomic import naming
from stiction_envs.reporting.png import save_full
from tuning.names import CHECKPOINT_EVERY
from tuning.policies.algorithms import (
    CheckpointCallback,
    EvalCallback,
    export,
    least_steps,
    load_checkpoint,
    log_to,
    make_env,
    make_model,
    settings_of,
)
from tuning.policies.policy import Policy
from tuning.policies.settings import PolicySettings
from tuning.policies.task import Task

CHECKPOINTS, POLICY, CURVE = "checkpoint", "policy.zip", "curve.csv"
"""Contents of the folder of a training; the first is removed when it is finished."""
_EVALUATIONS, _PART = "evaluations.npz", "next"  # what EvalCallback writes; a checkpoint in writing
TRAINED, UNDITHERED = "#1f5fa8", "#d1701a"
"""Colours of the curve."""
Progress = Callable[[str, float], None]
"""Called with a stage and the finished share of the training."""


class CurvePoint(NamedTuple):
    """One evaluation, a row of ``curve.csv``: mean return of its episodes, without exploration."""

    steps: int  # of all arms together
    evaluation_return: float
    evaluation_std: float


@dataclass(frozen=True, kw_only=True)
class Trained:
    """Result of a training."""

    policy: Policy  # Policy of the best evaluation
    points: tuple[CurvePoint, ...]
    resumed_at: int | None  # Steps of the checkpoint from which it went on, None for none

    @property
    def best(self) -> CurvePoint:
        """The evaluation whose policy was saved."""
        return max(self.points, key=lambda p: p.evaluation_return)


@dataclass(frozen=True, kw_only=True)
class Training:
    """Definition of a training."""

    task: Task
    algorithm: str
    steps: int  # Steps of all arms together; the last rollout may exceed it
    seed: int = 0
    checkpoint_every: int = CHECKPOINT_EVERY
    settings: PolicySettings

    def check(self) -> None:
        """Raise a StictionError if the training cannot be run; nothing is written."""
        own = settings_of(self.algorithm, self.settings)
        least, why = least_steps(own)
        if self.steps < least:
            raise StictionError(f"{self.steps} steps: expected at least {least}: {why}")
        env = make_env(self.task, min(2, own.envs), self.settings.run, own)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of fewer arms than there will be
            make_model(self.algorithm, own, env, self.seed)
        core = env.unwrapped.env.unwrapped.core  # type: ignore[attr-defined]
        drawn, first = getattr(core, "random_paths", 0), self.settings.run.test_paths
        env.close()
        if drawn > first:
            raise StictionError(
                f"random_paths {drawn}: expected at most {first}: policies are evaluated on the "
                "others"
            )

    def run(self, out: Path, progress: Progress | None = None) -> Trained:
        """Train in an existing folder, or go on from the last checkpoint there.

        ``policy.zip`` and ``curve.csv`` are there from the first evaluation on.

        Raises:
            StictionError: a checkpoint that cannot be read.
        """
        at, points = None, _read_curve(out / CURVE)
        if not points or points[-1].steps < self.steps:
            at = self._learn(out, progress)
            points = _read_curve(out / CURVE)
        shutil.rmtree(out / CHECKPOINTS, ignore_errors=True)
        return Trained(policy=Policy.load(out / POLICY), points=points, resumed_at=at)

    def draw_curve(self, path: Path, points: Sequence[CurvePoint]) -> None:
        """Draw returns over steps; the shade is the standard deviation over the episodes."""
        figure = Figure(figsize=(8, 4.5), layout="constrained")
        axes = figure.subplots()
        steps, mean, spread = np.array(points).T
        axes.fill_between(steps, mean - spread, mean + spread, color=TRAINED, alpha=0.15, lw=0)
        axes.plot(steps, mean, "o-", ms=3, color=TRAINED, label="evaluation, ± std of episodes")
        best = int(np.argmax(mean))
        axes.plot(steps[best], mean[best], "o", ms=9, mfc="none", color=TRAINED, label="kept")
        kind = EXPERIMENTS[self.task.experiment]
        if kind.undithered_return is not None:
            axes.axhline(kind.undithered_return, color=UNDITHERED, ls="--", lw=1, label="no dither")
        axes.set_xlabel("steps of all arms")
        axes.set_ylabel(kind.returns)
        axes.set_title(f"{self.algorithm.upper()} on {self.task.name}, seed {self.seed}")
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
        save_full(figure, path)

    def _learn(self, out: Path, progress: Progress | None) -> int | None:
        """Train the rest; return the steps that were done before, None for none."""
        own, run = settings_of(self.algorithm, self.settings), self.settings.run
        env = make_env(self.task, own.envs, run, own)
        evaluations = _Evaluations(self, out, progress)
        place = newest(out / CHECKPOINTS)
        if place is None:
            model = make_model(self.algorithm, own, env, self.seed)
        else:
            model = load_checkpoint(self.algorithm, place, env)
            # not the episodes and the noise of the beginning once more
            model.set_random_seed(far_seed(self.seed, model.num_timesteps))
            shutil.copyfile(place / POLICY, out / POLICY)
            evaluations.restore(place / _EVALUATIONS)
        log_to(model, out / "tensorboard")
        checkpoints = _Checkpoints(out, max(1, self.checkpoint_every // own.envs))
        before = model.num_timesteps
        model.learn(
            self.steps - before, callback=[evaluations, checkpoints], reset_num_timesteps=not before
        )
        return before or None


class _Evaluations(EvalCallback):
    """Evaluations on the same episodes each time, also before the first and after the last step.

    Writes the curve, keeps the best policy and reports the progress.
    """

    def __init__(self, training: Training, out: Path, progress: Progress | None) -> None:
        own, run = settings_of(training.algorithm, training.settings), training.settings.run
        env = make_env(training.task, run.evaluation_episodes, run, own)
        # it takes over the training's normalisation
        env.training, env.norm_reward = False, False
        super().__init__(
            env,
            n_eval_episodes=env.num_envs,
            eval_freq=max(1, run.evaluation_every // own.envs),
            log_path=str(out / CHECKPOINTS),
            verbose=0,
        )
        self._training, self._out, self._progress = training, out, progress

    def restore(self, file: Path) -> None:
        """Go on from the evaluations in a checkpoint's file."""
        with np.load(file) as found:
            self.evaluations_timesteps = found["timesteps"].tolist()
            # rows of single precision, whose means are those from before
            self.evaluations_results = list(found["results"])
            self.evaluations_length = list(found["ep_lengths"])
        self.best_mean_reward = max(float(np.mean(x)) for x in self.evaluations_results)

    def _on_training_start(self) -> None:
        if not self.evaluations_timesteps:
            self._on_step()

    def _on_training_end(self) -> None:
        if self.evaluations_timesteps[-1] != self.num_timesteps:
            self.eval_freq = 1
            self._on_step()

    def _on_step(self) -> bool:
        training, count, best = self._training, len(self.evaluations_results), self.best_mean_reward
        self.eval_env.seed(far_seed(training.seed, 1))  # of the next reset
        with naming(self._out / CHECKPOINTS / _EVALUATIONS):
            goes_on = super()._on_step()
        if len(self.evaluations_results) > count:
            if self.best_mean_reward > best:
                described = {
                    "algorithm": training.algorithm,
                    "steps": int(self.num_timesteps),
                    "seed": training.seed,
                    "arguments": {k: repr(v) for k, v in sorted(training.task.arguments.items())},
                }
                export(self.model, training.task, described).save(self._out / POLICY)
            pairs = zip(self.evaluations_timesteps, self.evaluations_results, strict=True)
            rows = [(steps, float(np.mean(x)), float(np.std(x))) for steps, x in pairs]
            write_lines(self._out / CURVE, CurvePoint._fields, rows)
        if self._progress is not None:
            last = np.mean(self.evaluations_results[-1])
            words = f"{training.algorithm}: return {last:.3f}, best {self.best_mean_reward:.3f}"
            self._progress(words, min(1.0, self.num_timesteps / training.steps))
        return goes_on


class _Checkpoints(CheckpointCallback):
    """Checkpoints of which the newest stays; a folder of one is complete or absent.

    Networks with their optimisers, normalisation, the replay buffer if there is one, evaluations,
    best policy. Stable-Baselines3 pickles the first three: a stranger's checkpoint can run code.
    """

    def __init__(self, out: Path, every: int) -> None:
        part = str(out / CHECKPOINTS / _PART)
        super().__init__(every, part, save_replay_buffer=True, save_vecnormalize=True)
        self._out = out

    def _on_step(self) -> bool:
        if self.n_calls % self.save_freq:
            return True
        folder, part = self._out / CHECKPOINTS, Path(self.save_path)
        old = [p for p in folder.iterdir() if p.is_dir()]
        place = folder / f"{self.num_timesteps:09d}"
        try:
            with naming(place):
                part.mkdir(exist_ok=True)
                goes_on = super()._on_step()
                shutil.copyfile(self._out / POLICY, part / POLICY)
                shutil.copyfile(folder / _EVALUATIONS, part / _EVALUATIONS)
                os.replace(part, place)
        except (OSError, RuntimeError):
            shutil.rmtree(part, ignore_errors=True)
            raise
        for other in old:
            shutil.rmtree(other, ignore_errors=True)
        return goes_on


def newest(folder: Path) -> Path | None:
    """Return the newest complete checkpoint in a folder; None if there is none."""
    found = folder.iterdir() if folder.is_dir() else ()
    return max((p for p in found if p.is_dir() and p.name != _PART), default=None)


def far_seed(seed: int, which: int) -> int:
    """Return a first seed of episodes that is far from the others, and from the training's."""
    return int(np.random.SeedSequence([seed, which]).generate_state(1)[0]) % 2**31


def _read_curve(path: Path) -> tuple[CurvePoint, ...]:
    """Return the points of a curve's file; none if there is no file."""
    if not path.is_file():
        return ()
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).tolist()
    return tuple(CurvePoint(int(steps), *more) for steps, *more in rows)
