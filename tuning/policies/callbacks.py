"""Stable-Baselines3's evaluations and checkpoints, with what a training's folder needs."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from stable_baselines3.common.callbacks import CheckpointCallback, EvalCallback
from stable_baselines3.common.vec_env import VecNormalize

from stiction_envs.reporting.atomic import naming

_PART = "next"  # name of a checkpoint that is being written


class Evaluations(EvalCallback):
    """Evaluations on the same episodes each time, also before the first and after the last step."""

    def __init__(
        self,
        env: VecNormalize,
        folder: Path,
        *,
        seed: int,
        every: int,
        evaluated: Callable[[Evaluations], None],
        say: Callable[[Evaluations], None],
    ) -> None:
        """Prepare.

        Args:
            env: environment with one arm per episode; it takes over the training's normalisation.
            folder: where ``evaluations.npz`` is written.
            seed: seed of the episodes.
            every: steps of each arm between two evaluations.
            evaluated: called after each evaluation.
            say: called after each step.
        """
        env.training, env.norm_reward = False, False
        super().__init__(
            env, n_eval_episodes=env.num_envs, eval_freq=every, log_path=str(folder), verbose=0
        )
        self.file = folder / "evaluations.npz"
        """The evaluations so far, as Stable-Baselines3 writes them."""
        self.improved = False
        """Whether the last evaluation was the best so far."""
        self._seed, self._evaluated, self._say = seed, evaluated, say

    def restore(self) -> None:
        """Go on from the evaluations in the file."""
        with np.load(self.file) as file:
            self.evaluations_timesteps = file["timesteps"].tolist()
            # rows of single precision, whose means are those from before
            self.evaluations_results = list(file["results"])
            self.evaluations_length = list(file["ep_lengths"])
        means = np.mean(self.evaluations_results, axis=1)
        self.last_mean_reward, self.best_mean_reward = float(means[-1]), float(means.max())

    def _on_training_start(self) -> None:
        if not self.evaluations_timesteps:
            self._on_step()

    def _on_training_end(self) -> None:
        if self.evaluations_timesteps[-1] != self.num_timesteps:
            self.eval_freq = 1
            self._on_step()

    def _on_step(self) -> bool:
        count, best = len(self.evaluations_timesteps), self.best_mean_reward
        self.eval_env.seed(self._seed)  # of the next reset
        with naming(self.file):
            goes_on = super()._on_step()
        if len(self.evaluations_timesteps) > count:
            self.improved = self.best_mean_reward > best
            self._evaluated(self)
        self._say(self)
        return goes_on


class Checkpoints(CheckpointCallback):
    """Checkpoints of which the newest stays; a folder of one is complete or absent.

    The networks with their optimisers, the normalisation, the replay buffer if there is one, and
    more files. Stable-Baselines3 pickles the first three: a checkpoint of a stranger can run code.
    """

    def __init__(self, folder: Path, *, every: int, more: Sequence[Path]) -> None:
        """Prepare.

        Args:
            folder: folder of the checkpoints.
            every: steps of each arm between two.
            more: files that belong to a checkpoint.
        """
        super().__init__(
            every, str(folder / _PART), save_replay_buffer=True, save_vecnormalize=True
        )
        self._folder, self._more = folder, more

    def copy_back(self, place: Path) -> None:
        """Copy the further files of a checkpoint to where they were."""
        for file in self._more:
            shutil.copyfile(place / file.name, file)

    def _on_step(self) -> bool:
        if self.n_calls % self.save_freq:
            return True
        part, old = self._folder / _PART, [p for p in self._folder.iterdir() if p.is_dir()]
        place = self._folder / f"{self.num_timesteps:09d}"
        try:
            with naming(place):
                part.mkdir(exist_ok=True)
                goes_on = super()._on_step()
                for file in self._more:
                    shutil.copyfile(file, part / file.name)
                os.replace(part, place)
        except (OSError, RuntimeError):
            shutil.rmtree(part, ignore_errors=True)
            raise
        for other in old:
            shutil.rmtree(other, ignore_errors=True)
        return goes_on


def newest(folder: Path) -> Path | None:
    """Return the newest complete checkpoint; None if there is none."""
    found = folder.iterdir() if folder.is_dir() else ()
    return max((p for p in found if p.is_dir() and p.name != _PART), default=None)
