"""What happens while a policy is trained: evaluations, the curve, checkpoints, the bar."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tuning.policies.extra import (
    BaseCallback,
    VecNormalize,
    evaluate_policy,
    sync_envs_normalization,
)

Say = Callable[[str, int], None]
"""Called with what is being done and the steps so far."""


@dataclass(frozen=True, kw_only=True)
class CurvePoint:
    """One evaluation; a row of ``curve.csv``. No time is in it: the same seed, the same file."""

    steps: int
    """Of all arms together."""
    updates: int
    """Gradient steps (PPO: epochs)."""
    episodes: int
    """Episodes of training that ended since the point before."""
    training_return: float
    """Their mean return, exploration included; NaN where none ended."""
    evaluation_return: float
    """Mean return of the evaluation's episodes, without exploration."""
    evaluation_std: float
    """Standard deviation of these returns."""
    evaluation_length: float
    """Mean length of these episodes [steps]."""


def _point(row: Mapping[str, Any]) -> CurvePoint:
    """Return a point as a checkpoint has it: JSON has no NaN."""
    values: dict[str, Any] = {k: np.nan if v is None else v for k, v in row.items()}
    return CurvePoint(**values)


class Evaluations(BaseCallback):
    """Evaluates at the start, at intervals and at the end, on the same episodes every time.

    As Stable-Baselines3's `EvalCallback`, whose episodes go on from one evaluation to the next, so
    that no two can be compared, nor the second one repeated after an interruption.
    """

    def __init__(
        self, env: VecNormalize, *, seed: int, every: int, keep_best: Callable[[], None], say: Say
    ) -> None:
        """Prepare.

        Args:
            env: with one arm per episode; its normalisation becomes that of the training.
            seed: of its episodes.
            every: steps between two evaluations.
            keep_best: called after an evaluation that is better than all before.
            say: called after each.
        """
        super().__init__()
        env.training, env.norm_reward = False, False
        self._env, self._seed, self._every = env, seed, every
        self._keep_best, self._say = keep_best, say
        self._ended: list[float] = []
        self.points: list[CurvePoint] = []
        self.seconds = 0.0
        """Spent in this process."""

    @property
    def best(self) -> CurvePoint | None:
        """The best evaluation so far, the earliest of these."""
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

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint keeps, JSON."""
        return {"points": [asdict(p) for p in self.points], "ended": self._ended}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a checkpoint."""
        # JSON has no NaN
        self.points = [_point(p) for p in state["points"]]
        self._ended = list(state["ended"])


class Checkpoints(BaseCallback):
    """Saves between two rollouts, where nothing is half done; says how far the training is."""

    def __init__(self, every: int, save: Callable[[], None], say: Callable[[int], None]) -> None:
        """Prepare to ``save`` every so many steps; ``say`` is called with the steps so far."""
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
