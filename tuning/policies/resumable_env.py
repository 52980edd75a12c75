"""A batch that can be stored within an episode and resumed with the same bits.

The physics of N moving arms cannot be stored. But an episode is determined by its random generator
at its start and the actions since: these are stored, and replayed when a training resumes.
Replaying takes as long as the longest unfinished episode did.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from stiction_envs.envs.sb3 import SB3VecEnv

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

States = list[dict[str, object]]
_SPARE = 1000  # steps that no episode needs any more, before they are dropped (assumed)


class ResumableVecEnv(SB3VecEnv):
    """An `SB3VecEnv` that records how its present episodes came about.

    Reset options are not recorded: use ``fixed_options`` for what must hold in all episodes.
    """

    def __init__(self, env: VectorEnv) -> None:
        """Adapt a vector environment."""
        super().__init__(env)
        self._start: States = [{} for _ in range(self.num_envs)]
        self._next: States = [{} for _ in range(self.num_envs)]
        self._played: list[NDArray[np.float32]] = []
        self._since = np.zeros(self.num_envs, dtype=np.int64)

    def reset(self) -> NDArray[np.float32]:
        """Start all episodes with the seeds that were set, or with other seeds."""
        if self._seeds[0] is None:
            self.seed()
        self._start = [dict(seeding.np_random(s)[0].bit_generator.state) for s in self._seeds]
        observation = super().reset()
        self._next = self._states()
        self._played, self._since = [], np.zeros(self.num_envs, dtype=np.int64)
        return observation

    def step_wait(self) -> VecEnvStepReturn:
        """Step all environments."""
        self._actions = np.array(self._actions, dtype=np.float32)
        self._played.append(self._actions)
        out = super().step_wait()
        if (ended := np.flatnonzero(out[2])).size:
            now = self._states()
            for i in ended:
                # an episode draws random numbers only when it starts
                self._start[i], self._next[i] = self._next[i], now[i]
            self._since[ended] = len(self._played)
        if (spare := int(self._since.min())) > _SPARE:
            self._played, self._since = self._played[spare:], self._since - spare
        return out

    def _states(self) -> States:
        batch: Any = self.env.unwrapped
        return [dict(rng.bit_generator.state) for rng in batch.generators]

    # ---- to disk and back --------------------------------------------------------------------

    def snapshot(self) -> tuple[States, list[NDArray[np.float32]]]:
        """Return the generators at the start of the present episodes, and the actions since.

        The actions of each are (steps, actions), in [-1, 1].
        """
        shape = self.action_space.shape or ()
        empty = np.zeros((0, *shape), dtype=np.float32)
        actions = [
            np.array([batch[i] for batch in self._played[since:]])
            if since < len(self._played)
            else empty
            for i, since in enumerate(self._since)
        ]
        return list(self._start), actions

    def restore(
        self, start: Sequence[Mapping[str, object]], actions: Sequence[NDArray[np.float32]]
    ) -> NDArray[np.float32]:
        """Bring all arms to the state of `snapshot`; return the observations (N, …) there."""
        lengths = np.array([len(a) for a in actions])
        longest = int(lengths.max())
        batch: Any = self.env.unwrapped
        played = np.full(
            (longest, self.num_envs, *(self.action_space.shape or ())), -1.0, np.float32
        )
        for i, a in enumerate(actions):
            played[longest - len(a) :, i] = a
        # an arm waits in another episode until its own starts
        observation, _ = self.env.reset(seed=0)
        for k in range(longest + 1):
            beginning = lengths == longest - k
            if beginning.any():
                for arm in map(int, np.flatnonzero(beginning)):
                    batch.generators[arm].bit_generator.state = start[arm]
                observation, _ = self.env.reset(options={"reset_mask": beginning})
            if k < longest:
                observation, *_ = self.env.step(self.scale(played[k]))
        self._start, self._next = [dict(s) for s in start], self._states()
        self._played, self._since = list(played), np.asarray(longest - lengths)
        return observation
