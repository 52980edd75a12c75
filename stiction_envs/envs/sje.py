"""The Single Joint Experiment as a Gymnasium environment, alone and as a native batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from stiction_envs.envs.core import TERMS, Core, Step
from stiction_envs.envs.render import RENDER_MODES, Renderer, check_render_mode
from stiction_envs.errors import StictionError, unknown

Observation = NDArray[np.float32]
Action = NDArray[np.float32]
Index = NDArray[np.int64]


class SJEEnv(gymnasium.Env[Observation, Action]):
    """Break a sticking joint free with as little torque as possible, by dithering the arm.

    ## Description
    The Single Joint Experiment (thesis 3.2): the arm rests in a pose, one joint is free, and the
    torque commanded on it grows by 0.07 N·m/s until the joint has turned by 0.15 rad. The torque at
    that moment is τ_SJE; without dither it is τ_base. Dither – a sine on the commanded torque of
    any joint – lets the joint break away earlier. An episode is one ramp of one configuration: a
    joint, its load or no-load pose, and a direction. Every step sets the dither of all joints for
    the next `control_interval_s`; phases stay continuous. The numbers of the protocol are in
    `stiction_envs/experiments/sje.toml`.

        import gymnasium as gym

        env = gym.make("stiction_envs:PandaSJE-v0")
        observation, info = env.reset(seed=1, options={"joint": 7, "load": "no_load"})

    `gym.make_vec("stiction_envs:PandaSJE-v0", num_envs=64)` steps 64 arms in one batch
    (`SJEVectorEnv`); row i of a batch is a single environment reset with seed + i, bit for bit.

    ## Action space
    `Box`, shape (2n,), float32, for an arm of n joints (n = 7 below):

    | index | meaning | min | max | unit |
    | --- | --- | --- | --- | --- |
    | 0–6 | amplitude, joint 1 … 7 | 0 | A_max = min(torque limit, 2.5 × stiction) | N·m |
    | 7–13 | frequency, joint 1 … 7 | 5 | min(100, controller rate / 2) | Hz |

    The stiction is the joint's largest, of both poses and directions. Amplitude 0 is exactly no
    dither, whatever the frequency. An action outside the space, or not a number, is an error; wrap
    the environment in `gymnasium.wrappers.RescaleAction(env, -1, 1)` for actions in [-1, 1].

    ## Observation space
    `Box`, shape (5n + 5,), float32, clipped to its bounds. `env.unwrapped.observation_names` has
    the name of every element. Threshold is 0.15 rad. After a reset, amplitude and frequency are −1.

    | index | name | min | max | unit | meaning |
    | --- | --- | --- | --- | --- | --- |
    | 0–6 | displacement_1 … displacement_7 | -5 | 5 | threshold | link angle minus the pose |
    | 7–13 | velocity_1 … velocity_7 | -50 | 50 | threshold/s | link speed |
    | 14 | progress | -5 | 5 | threshold | angle since the ramp started, along the ramp |
    | 15 | torque | -10 | 10 | τ_base | commanded torque of the tested joint, dither excluded |
    | 16 | elapsed | 0 | 20 | τ_base | torque by which the ramp has grown |
    | 17–23 | tested_1 … tested_7 | 0 | 1 | 1 | 1 for the tested joint, else 0 |
    | 24 | load | 0 | 1 | 1 | 1 in the load pose, 0 in the no-load pose |
    | 25 | direction | -1 | 1 | 1 | sign of the ramp |
    | 26–32 | amplitude_1 … amplitude_7 | -1 | 1 | 1 | last amplitude; −1 is 0, +1 is A_max |
    | 33–39 | frequency_1 … frequency_7 | -1 | 1 | 1 | last frequency; −1 is f_min, +1 is f_max |

    ## Rewards
    Terms, in `info["reward_terms"]`; the reward is their sum. Δ is the change within the step.

    * `breakaway`: 1 when the joint breaks away, else 0.
    * `torque`: −Δ|τ| / |τ_base|, τ the commanded torque without dither, 0 before the first step.
    * `power`: −`power_weight` · s · mean over joints of (A / A_max)².
    * `torque_rate`: −`torque_rate_weight` · s · mean over joints of (2πfA / torque rate limit)²;
      0 where the robot has no such limit.

    s = `control_interval_s` · 0.07 N·m/s / |τ_base| is the step's share of an undithered ramp: a
    weight is what full dither would cost over such a ramp, in units of torque reduction. Over an
    episode that ends by breakaway the rewards sum to 1 − |τ_SJE| / |τ_base| less the penalties.
    τ_base is computed without dither and scatter on the same model, once per process.

    ## Start and end of an episode
    A reset puts the arm near the pose, moves it there as between two repeats, waits until it rests
    and starts the ramp: at zero torque on the Panda, at the averaged external torque on the iiwa.
    With `scatter` the pose, the friction, the phases of the dither and the torque readings vary
    with the seed.

    * Terminated: the joint has turned by the threshold.
    * Truncated: the joint is given up as stuck (`give_up_factor` of the protocol), or
      `max_episode_steps` are over. There is no `breakaway` reward then.

    ## Info
    `joint` (1 … n), `load` and `direction` always; `torque` [N·m], `displacement` [rad], `time` [s]
    and `reward_terms` after a step; after the last one also `tau_sje`, `tau_base` (both signed,
    N·m) and `reduction` = 1 − |τ_SJE| / |τ_base|. Truncated: `tau_sje` and `reduction` are NaN.

    ## Options
    `env.reset(options={"joint": 1 … n, "load": "load" | "no_load", "direction": "+" | "-"})`; what
    is not given is drawn from the seed.

    ## Arguments
    * `robot`: `panda` (default of `PandaSJE-v0`), `iiwa7` (default of `IiwaSJE-v0`), `iiwa14`, or a
      path to an own MJCF or URDF with 2 to 9 joints.
    * `payload`: mass [kg] and centre of mass x, y, z [m] in the flange frame. Default none.
    * `tilt`: roll and pitch of the base [rad]. Default (0, 0).
    * `scatter`: whether episodes of a configuration differ. Default True.
    * `friction`: path to a TOML, or `FrictionParameters`. Default: the robot's own.
    * `control_interval_s`: time of a step, a multiple of 0.05 s. Default 0.1 s.
    * `power_weight`, `torque_rate_weight`: weights of the penalties [-]. Default 0.01 each.
    * `max_episode_steps`: default 1000; `gym.make` gives it to a `TimeLimit`, which only shortens.
    * `fixed_options`: reset options of all episodes; those of a single reset come before them.
    * `nthread`: threads of the physics, 0 for all processors. Default 0.
    * `render_mode`: `human`, `rgb_array` (scene, torque and displacement; 450 × 800 × 3) or
      `depth_array` (the scene only, metres, 450 × 460).

    ## Version history
    * v0: first version.
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # noqa: RUF012

    def __init__(self, *, render_mode: str | None = None, **arguments: Any) -> None:
        """Make the environment; the class explains the arguments."""
        check_render_mode(render_mode)
        self.render_mode = render_mode
        self.core = Core(1, record=render_mode is not None, **arguments)
        self.metadata = _metadata(self.core)
        self.action_space = self.core.action_space
        self.observation_space = self.core.observation_space
        self._renderer: Renderer | None = None

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Name of every element of the observation."""
        return self.core.observation_names

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; see the class for the options."""
        super().reset(seed=seed)
        self.core.reset(_ONE, [self.np_random], [options])
        self._show()
        return self.core.observe(_ONE)[0], _configuration(self.core, 0)

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Dither with ``action`` [N·m, Hz] for one control interval."""
        step = self.core.step(_ONE, np.asarray(action)[None])
        ended = bool(step.terminated[0] or step.truncated[0])
        info: dict[str, Any] = _configuration(self.core, 0)
        info |= {name: float(getattr(step, name)[0]) for name in _EACH}
        info["reward_terms"] = {name: float(step.terms[name][0]) for name in TERMS}
        if ended:
            info |= {name: float(getattr(step, name)[0]) for name in _FINAL}
        self._show()
        observation = self.core.observe(_ONE)[0]
        reward = float(step.reward[0])
        return observation, reward, bool(step.terminated[0]), bool(step.truncated[0]), info

    def render(self) -> Any:
        """Return the frame of the present moment, None in human mode."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            self._renderer = Renderer(self.core)
        return self._renderer.frame(0, self.render_mode)

    def _show(self) -> None:
        if self.render_mode == "human":
            self.render()

    def close(self) -> None:
        """Close the window and free the graphics context."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class SJEVectorEnv(VectorEnv[Observation, Action, NDArray[Any]]):
    """N arms of `SJEEnv`, stepped in one batch; infos are Gymnasium's dict of arrays.

    `reset(seed=s)` gives environment i the seed s + i; a list gives each its own. ``options`` are
    those of `SJEEnv` for all, or a sequence with one dict per environment; ``"reset_mask"`` (bool
    array) among them resets only some. An episode that autoreset starts knows `fixed_options` only.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        """Make the environments.

        Args:
            num_envs: how many.
            autoreset_mode: `NextStep` (Gymnasium's default), `SameStep` or `Disabled`.
            render_mode: one frame per environment; `human` is for the single environment.
            arguments: as for `SJEEnv`.
        """
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = [m.value for m in AutoresetMode]
            raise unknown("autoreset mode", autoreset_mode, modes) from None
        check_render_mode(render_mode, batch=True)
        self.render_mode = render_mode
        self.num_envs = num_envs
        self.core = Core(num_envs, record=render_mode is not None, **arguments)
        self.metadata = {**_metadata(self.core), "autoreset_mode": self.autoreset_mode}
        self.single_action_space = self.core.action_space
        self.single_observation_space = self.core.observation_space
        self.action_space = batch_space(self.core.action_space, num_envs)
        self.observation_space = batch_space(self.core.observation_space, num_envs)
        self._rngs: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.zeros(num_envs, dtype=bool)
        self._renderer: Renderer | None = None

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Name of every element of an observation."""
        return self.core.observation_names

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: Mapping[str, Any] | Sequence[Mapping[str, Any] | None] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Start episodes in all environments, or in those of ``options["reset_mask"]``."""
        ids, per_env = self._targets(options)
        if seed is None or isinstance(seed, (int, np.integer)):
            start = None if seed is None else int(seed)
            seeds = [None if start is None else start + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        for what, values in (("seeds", seeds), ("options", per_env)):
            if len(values) != self.num_envs:
                raise StictionError(f"{len(values)} {what}: allowed are {self.num_envs}")
        for i in ids:
            if seeds[i] is not None or self._rngs[i] is None:
                self._rngs[i], _ = seeding.np_random(seeds[i])
        self._restart(ids, [per_env[i] for i in ids])
        infos: dict[str, Any] = {}
        self._add_configurations(infos, ids)
        return self._observe(), infos

    def _targets(self, options: Any) -> tuple[Index, list[Mapping[str, Any] | None]]:
        """Return which environments to reset, and the options of every one."""
        everyone = np.arange(self.num_envs)
        if options is None or isinstance(options, Mapping):
            options = dict(options or {})
            mask = options.pop("reset_mask", None)
            if mask is None:
                return everyone, [options] * self.num_envs
            mask = np.asarray(mask)
            if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
                raise StictionError(
                    f"reset_mask: allowed is a bool array of shape ({self.num_envs},), one True"
                )
            return np.flatnonzero(mask), [options] * self.num_envs
        if isinstance(options, str):
            raise StictionError("reset options are a str: allowed is a dict, or a list of dicts")
        return everyone, list(options)

    def _restart(self, ids: Index, options: Sequence[Mapping[str, Any] | None]) -> None:
        rngs = [rng for i in ids if (rng := self._rngs[i]) is not None]
        self.core.reset(ids, rngs, options)
        self._ended[ids] = False

    def _observe(self) -> Observation:
        return self.core.observe(np.arange(self.num_envs))

    def step(
        self, actions: Action
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Step all environments; those whose episode is over start anew, per `autoreset_mode`."""
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise StictionError(
                f"actions have shape {actions.shape}: allowed is {self.action_space.shape}"
            )
        waiting = np.flatnonzero(self._ended)
        if len(waiting) and self.autoreset_mode is not AutoresetMode.NEXT_STEP:
            raise StictionError(f"step: the episode of environment {waiting[0]} is over: reset it")
        ids = np.flatnonzero(~self._ended)
        infos: dict[str, Any] = {}
        reward = np.zeros(self.num_envs)
        terminated, truncated = np.zeros((2, self.num_envs), dtype=bool)
        result = self.core.step(ids, actions[ids]) if len(ids) else None
        if len(waiting):
            self._restart(waiting, [None] * len(waiting))
        if result is not None:
            reward[ids] = result.reward
            terminated[ids], truncated[ids] = result.terminated, result.truncated
        ended = terminated | truncated
        self._ended = ended.copy()
        observation = self._observe()
        if self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            observation = self._same_step(observation, ended, ids, result, infos)
        else:
            self._add_configurations(infos, np.arange(self.num_envs))
            if result is not None:
                self._add_step(infos, ids, result, np.ones(len(ids), dtype=bool))
        return observation, reward, terminated, truncated, infos

    def _same_step(
        self,
        observation: Observation,
        ended: NDArray[np.bool_],
        ids: Index,
        result: Step | None,
        infos: dict[str, Any],
    ) -> Observation:
        """Reset what has ended; its last observation and info become `final_obs`, `final_info`."""
        assert result is not None
        over = np.flatnonzero(ended)
        last: dict[str, Any] = {}
        self._add_configurations(last, over)
        self._add_step(last, ids, result, ended[ids])
        finals = np.full(self.num_envs, None, dtype=object)
        for i in over:
            finals[i] = observation[i].copy()
        infos.update(final_obs=finals, _final_obs=ended.copy())
        infos.update(final_info=last, _final_info=ended.copy())
        self._restart(over, [None] * len(over))
        self._add_configurations(infos, np.arange(self.num_envs))
        if not ended.all():
            self._add_step(infos, ids, result, ~ended[ids])
        observation[over] = self.core.observe(over)
        return observation

    def _add_configurations(self, infos: dict[str, Any], ids: Index) -> None:
        rows = [self.core.configuration[i] for i in ids]
        self._put(infos, "joint", ids, np.array([c.joint for c in rows]))
        for name in ("load", "direction"):
            self._put(infos, name, ids, np.array([getattr(c, name) for c in rows], dtype=object))

    def _add_step(
        self, infos: dict[str, Any], ids: Index, step: Step, which: NDArray[np.bool_]
    ) -> None:
        """Add what ``step`` of environments ``ids`` says about those of ``which``."""
        for name in _EACH:
            self._put(infos, name, ids[which], getattr(step, name)[which])
        terms: dict[str, Any] = {}
        for name in TERMS:
            self._put(terms, name, ids[which], step.terms[name][which])
        infos["reward_terms"], infos["_reward_terms"] = terms, terms[f"_{TERMS[0]}"].copy()
        final = which & (step.terminated | step.truncated)
        if final.any():
            for name in _FINAL:
                self._put(infos, name, ids[final], getattr(step, name)[final])

    def _put(self, infos: dict[str, Any], name: str, ids: Index, values: NDArray[Any]) -> None:
        """Add an info of some environments, with its mask: what `_add_info` makes, at once."""
        fill = None if values.dtype == object else values.dtype.type(0)
        infos[name] = np.full(self.num_envs, fill, dtype=values.dtype)
        infos[name][ids] = values
        infos[f"_{name}"] = np.zeros(self.num_envs, dtype=bool)
        infos[f"_{name}"][ids] = True

    def render(self) -> Any:
        """Return a tuple with one frame per environment, None without a render mode."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            self._renderer = Renderer(self.core)
        mode = self.render_mode
        return tuple(self._renderer.frame(i, mode) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Free the graphics context."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


_ONE = np.zeros(1, dtype=np.int64)
_EACH = ("torque", "displacement", "time")
_FINAL = ("tau_sje", "tau_base", "reduction")


def _configuration(core: Core, i: int) -> dict[str, Any]:
    c = core.configuration[i]
    return {"joint": c.joint, "load": c.load, "direction": c.direction}


def _metadata(core: Core) -> dict[str, Any]:
    return {**SJEEnv.metadata, "render_fps": max(1, round(1 / core.interval))}
