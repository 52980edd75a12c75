"""Stable-Baselines3 on the native batch: one `VecEnv` for all arms, no subprocesses.

    from stiction_envs.envs.sb3 import make_sb3

    env = VecMonitor(make_sb3("PandaSJE-v0", num_envs=32))
    PPO("MlpPolicy", env).learn(100_000)

Needs the extra `rl`: `pip install 'stiction-envs[rl]'`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from stiction_envs.errors import StictionError, missing_extra

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

    from stiction_envs.envs.gym_env import Info

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError:
    raise missing_extra("stiction_envs.envs.sb3", "stable-baselines3", "rl") from None


Numbers = NDArray[np.float32] | NDArray[np.float64]


class SB3VecEnv(VecEnv):
    """A same-step Gymnasium `VectorEnv` as a Stable-Baselines3 `VecEnv`.

    Actions are in [-1, 1] and are scaled to the environment's bounds: −1 is exactly the lowest, so
    amplitude −1 is exactly no dither. When an episode ends, the infos are those of its last step,
    with `terminal_observation` and `TimeLimit.truncated`; the returned observation is the first of
    the next episode, as Stable-Baselines3 expects.
    """

    def __init__(self, env: VectorEnv) -> None:
        """Adapt a vector environment with Box actions and observations, and mode `SameStep`.

        Raises:
            StictionError: another autoreset mode, or spaces other than Box.
        """
        mode = env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise StictionError(
                f"autoreset mode {getattr(mode, 'value', mode)!r}: Stable-Baselines3 needs "
                "'SameStep': gym.make_vec(..., autoreset_mode='SameStep')"
            )
        actions = env.single_action_space
        if not isinstance(actions, Box) or not isinstance(env.single_observation_space, Box):
            raise StictionError("SB3VecEnv: expected Box actions and observations")
        self.env = env
        self.spec = env.unwrapped.spec
        self._low = actions.low.astype(float)
        self._high = actions.high.astype(float)
        self._actions: Numbers = np.zeros((env.num_envs, *actions.shape))
        scaled = Box(-1.0, 1.0, actions.shape, np.float32)
        super().__init__(env.num_envs, env.single_observation_space, scaled)

    def scale(self, actions: Numbers) -> NDArray[np.float64]:
        """Return actions in [-1, 1] in the units of the environment [N·m, Hz]."""
        return self._low + 0.5 * (np.asarray(actions, float) + 1.0) * (self._high - self._low)

    def reset(self) -> NDArray[np.float32]:
        """Start all episodes, with the seeds and options that were set."""
        same = all(o == self._options[0] for o in self._options)
        options: Any = self._options[0] if same else self._options
        seeds: Any = None if self._seeds[0] is None else self._seeds
        observation, infos = self.env.reset(seed=seeds, options=options or None)
        self.reset_infos = [_row(infos, i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: Numbers) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step all environments."""
        actions = self.scale(self._actions)
        observation, reward, terminated, truncated, batch = self.env.step(actions)
        done = terminated | truncated
        final = batch.pop("final_info", None)
        last = batch.pop("final_obs", None)
        infos = []
        for i in range(self.num_envs):
            info = _row(batch, i)
            if done[i]:
                self.reset_infos[i] = info
                info = _row(final, i)
                info["terminal_observation"] = last[i]
            info["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            infos.append(info)
        return observation, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Close the vector environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[object]:
        """Return an attribute of the vector environment, once per index."""
        value = getattr(self.env.unwrapped, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: object, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the vector environment, which all environments share."""
        setattr(self.env.unwrapped, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: object,
        indices: VecEnvIndices = None,
        **method_kwargs: object,
    ) -> list[object]:
        """Call a method of the vector environment, once for all."""
        result = getattr(self.env.unwrapped, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return False: a native batch has no single environments to wrap."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return one frame per environment."""
        frames: Any = self.env.render()
        return [None] * self.num_envs if frames is None else list(frames)


def _row(batch: Info, i: int) -> Info:
    """Return the info of environment ``i`` from Gymnasium's dict of arrays and masks."""
    out: Info = {}
    for key, values in batch.items():
        mask = batch.get(f"_{key}")
        if mask is None or not mask[i]:
            continue
        if isinstance(values, dict):
            out[key] = _row(values, i)
        else:
            value = values[i]
            out[key] = value.item() if isinstance(value, np.generic) else value
    return out


def make_sb3(name: str, num_envs: int = 1, **arguments: Any) -> SB3VecEnv:
    """Return ``num_envs`` arms of a registered environment (``PandaSJE-v0``) as a `SB3VecEnv`."""
    if ":" not in name:
        name = f"stiction_envs:{name}"
    batch = gymnasium.make_vec(name, num_envs, autoreset_mode="SameStep", **arguments)
    return SB3VecEnv(batch)
