"""Callbacks of a training: evaluations, the curve, checkpoints, the progress bar."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize, sync_envs_normalization

from stiction_envs.measured.csv_text import write_lines
from stiction_envs.reporting.json_text import JsonRecord

Say = Callable[[str, int], None]
"""Called with the current activity and the steps so far."""


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """One evaluation, a row of ``curve.csv``; it holds no time, so a seed gives the same file."""

    steps: int
    """Steps of all arms together."""
    updates: int
    """Gradient steps (PPO: epochs)."""
    episodes: int
    """Episodes of training that ended since the last point."""
    training_return: float
    """Mean return of these, exploration included; NaN if none ended."""
    evaluation_return: float
    """Mean return of the evaluation's episodes, without exploration."""
    evaluation_std: float
    """Standard deviation of these returns."""
    evaluation_length: float
    """Mean length of these episodes [steps]."""


def write_curve(path: Path, points: Sequence[CurvePoint]) -> None:
    """Write a row per evaluation."""
    rows = [asdict(p) for p in points]
    write_lines(path, tuple(rows[0]), [tuple(row.values()) for row in rows])


class Evaluations(BaseCallback):
    """Evaluates at the start, at intervals and at the end, on the same episodes every time.

    Stable-Baselines3's `EvalCallback` continues its episodes from one evaluation to the next: no
    two can be compared, nor the second one repeated after an interruption.
    """

    def __init__(
        self, env: VecNormalize, *, seed: int, every: int, keep_best: Callable[[], None], say: Say
    ) -> None:
        """Prepare.

        Args:
            env: environment with one arm per episode; it takes over the training's normalisation.
            seed: seed of its episodes.
            every: steps between two evaluations.
            keep_best: called after an evaluation that is better than all before it.
            say: called after each.
        """
        super().__init__()
        env.training, env.norm_reward = False, False
        self._env, self._seed, self._every = env, seed, every
        self._keep_best, self._say = keep_best, say
        self._ended: list[float] = []
        self.points: list[CurvePoint] = []
        self.seconds = 0.0
        """Time spent in this process [s]."""

    @property
    def best(self) -> CurvePoint | None:
        """The best evaluation so far, the earliest of equals."""
        return max(self.points, key=lambda p: p.evaluation_return, default=None)

    def _on_training_start(self) -> None:
        if not self.points:
            self._evaluate()

    def _on_step(self) -> bool:
        self._ended += [float(i["episode"]["r"]) for i in self.locals["infos"] if "episode" in i]
        if self.num_timesteps // self._every > self.points[-1].steps // self._every:
            self._evaluate()
        return True

    def _on_training_end(self) -> None:
        if self.points[-1].steps != self.num_timesteps:
            self._evaluate()

    def _evaluate(self) -> None:
        start = time.monotonic()
        sync_envs_normalization(self.training_env, self._env)
        self._env.seed(self._seed)
        returns, lengths = evaluate_policy(
            self.model,
            self._env,
            n_eval_episodes=self._env.num_envs,
            return_episode_rewards=True,
        )
        point = CurvePoint(
            steps=self.num_timesteps,
            updates=int(getattr(self.model, "_n_updates", 0)),
            episodes=len(self._ended),
            training_return=float(np.mean(self._ended)) if self._ended else float("nan"),
            evaluation_return=float(np.mean(returns)),
            evaluation_std=float(np.std(returns)),
            evaluation_length=float(np.mean(lengths)),
        )
        before = self.best
        self.points.append(point)
        self._ended = []
        self.logger.record("eval/mean_reward", point.evaluation_return)
        self.logger.record("eval/mean_ep_length", point.evaluation_length)
        self.logger.dump(self.num_timesteps)
        if before is None or point.evaluation_return > before.evaluation_return:
            self._keep_best()
        self.seconds += time.monotonic() - start
        assert self.best is not None
        said = f"return {point.evaluation_return:.3f}, best {self.best.evaluation_return:.3f}"
        self._say(said, self.num_timesteps)

    # ---- to disk and back --------------------------------------------------------------------

    def state(self) -> dict[str, object]:
        """Return the state for a checkpoint, JSON."""
        return {"points": [asdict(p) for p in self.points], "ended": self._ended}

    def restore(self, state: JsonRecord) -> None:
        """Continue from a checkpoint."""
        for row in state["points"]:
            # JSON has no NaN
            values: JsonRecord = {k: np.nan if v is None else v for k, v in row.items()}
            self.points.append(CurvePoint(**values))
        self._ended = list(state["ended"])


class Checkpoints(BaseCallback):
    """Saves between two rollouts, where nothing is half done; reports the progress."""

    def __init__(self, every: int, save: Callable[[], None], say: Callable[[int], None]) -> None:
        """Prepare to ``save`` at this interval; ``say`` is called with the steps so far."""
        super().__init__()
        self._every, self._save, self._say = every, save, say
        self._last = 0

    def _on_training_start(self) -> None:
        self._last = self.num_timesteps

    def _on_rollout_start(self) -> None:
        self._say(self.num_timesteps)
        if self.num_timesteps // self._every > self._last // self._every:
            self._last = self.num_timesteps
            self._save()

    def _on_step(self) -> bool:
        return True
