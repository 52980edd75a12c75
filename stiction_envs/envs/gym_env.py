"""Gymnasium's `Env` and `VectorEnv` around a core: what every environment of the project shares."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from stiction_envs.envs.batch_core import BatchCore, Index, Outcome
from stiction_envs.envs.render.frames import RENDER_MODES, Renderer, check_render_mode
from stiction_envs.envs.tiles import Tiles
from stiction_envs.errors import StictionError, unknown

Observation = NDArray[np.float32]
Action = NDArray[np.float32]


class ArmEnv(gymnasium.Env[Observation, Action]):
    """A core of one simulation as a Gymnasium environment; subclasses say which core."""

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        make_core: Callable[..., BatchCore],
        make_renderer: Callable[[Any], Renderer],
        render_mode: str | None,
        arguments: Mapping[str, Any],
    ) -> None:
        """Make the environment.

        Args:
            make_core: called with the number of simulations, ``record`` and ``arguments``.
            make_renderer: called with the core at the first frame.
            render_mode: one of `RENDER_MODES`, or None.
            arguments: of the core.
        """
        check_render_mode(render_mode)
        self.render_mode = render_mode
        self.core: Any = make_core(1, record=render_mode is not None, **arguments)
        self.metadata = _metadata(self.core)
        self.action_space = self.core.action_space
        self.observation_space = self.core.observation_space
        self._make_renderer = make_renderer
        self._renderer: Renderer | None = None

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Name of every element of the observation."""
        names: tuple[str, ...] = self.core.observation_names
        return names

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; see the class for the options."""
        super().reset(seed=seed)
        self.core.reset(_ONE, [self.np_random], [options])
        self._show()
        return self.core.observe(_ONE)[0], self._describe()

    def _describe(self) -> dict[str, Any]:
        return {name: _first(values) for name, values in self.core.describe(_ONE).items()}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Dither with ``action`` [N·m, Hz] for one control interval."""
        step = self.core.step(_ONE, np.asarray(action)[None])
        ended = bool(step.terminated[0] or step.truncated[0])
        info = self._describe()
        info |= {name: _first(getattr(step, name)) for name in self.core.each}
        info["reward_terms"] = {name: float(step.terms[name][0]) for name in self.core.terms}
        if ended:
            info |= {name: _first(getattr(step, name)) for name in self.core.final}
        self._show()
        observation = self.core.observe(_ONE)[0]
        reward = float(step.reward[0])
        return observation, reward, bool(step.terminated[0]), bool(step.truncated[0]), info

    def render(self) -> Any:
        """Return the frame of the present moment, None in human mode."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            self._renderer = self._make_renderer(self.core)
        return self._renderer.frame(0, self.render_mode)

    def _show(self) -> None:
        if self.render_mode == "human":
            self.render()

    def close(self) -> None:
        """Close the window and free the graphics context."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class ArmVectorEnv(VectorEnv[Observation, Action, NDArray[Any]]):
    """N simulations, stepped in tiles of one batch each; infos are Gymnasium's dict of arrays."""

    def __init__(
        self,
        num_envs: int,
        make_core: type[BatchCore],
        make_renderer: Callable[[Any], Renderer],
        autoreset_mode: str | AutoresetMode,
        render_mode: str | None,
        arguments: Mapping[str, Any],
    ) -> None:
        """Make the environments; arguments as for `ArmEnv` and the subclass."""
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = [m.value for m in AutoresetMode]
            raise unknown("autoreset mode", autoreset_mode, modes) from None
        check_render_mode(render_mode, batch=True)
        self.render_mode = render_mode
        self.num_envs = num_envs
        self.tiles = Tiles(make_core, num_envs, record=render_mode is not None, **arguments)
        # of one tile; spaces, names and experiment are those of all
        self.core = self.tiles.cores[0]
        self.metadata = {**_metadata(self.core), "autoreset_mode": self.autoreset_mode}
        self.single_action_space = self.core.action_space
        self.single_observation_space = self.core.observation_space
        self.action_space = batch_space(self.core.action_space, num_envs)
        self.observation_space = batch_space(self.core.observation_space, num_envs)
        self._rngs: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.zeros(num_envs, dtype=bool)
        self._make_renderer = make_renderer
        self._renderers: dict[int, Renderer] = {}

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Name of every element of an observation."""
        names: tuple[str, ...] = self.core.observation_names
        return names

    @property
    def generators(self) -> list[np.random.Generator]:
        """Random generator of each environment, once it was reset: its episodes are drawn from it.

        Each draws when an episode starts, never within one.
        """
        return [rng for rng in self._rngs if rng is not None]

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
                raise StictionError(f"{len(values)} {what}: expected {self.num_envs}")
        for i in ids:
            if seeds[i] is not None or self._rngs[i] is None:
                self._rngs[i], _ = seeding.np_random(seeds[i])
        self._restart(ids, [per_env[i] for i in ids])
        infos: dict[str, Any] = {}
        self._add_descriptions(infos, ids)
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
                    f"reset_mask: expected a bool array of shape ({self.num_envs},), one True"
                )
            return np.flatnonzero(mask), [options] * self.num_envs
        if isinstance(options, str):
            raise StictionError("reset options are a str: expected a dict, or a list of dicts")
        return everyone, list(options)

    def _restart(self, ids: Index, options: Sequence[Mapping[str, Any] | None]) -> None:
        rngs = [rng for i in ids if (rng := self._rngs[i]) is not None]
        self.tiles.reset(ids, rngs, options)
        self._ended[ids] = False

    def _observe(self) -> Observation:
        observation: Observation = self.tiles.observe(np.arange(self.num_envs))
        return observation

    def step(
        self, actions: Action
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Step all environments; those whose episode is over start anew, per `autoreset_mode`."""
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise StictionError(
                f"actions have shape {actions.shape}: expected {self.action_space.shape}"
            )
        waiting = np.flatnonzero(self._ended)
        if len(waiting) and self.autoreset_mode is not AutoresetMode.NEXT_STEP:
            raise StictionError(f"step: the episode of environment {waiting[0]} is over: reset it")
        ids = np.flatnonzero(~self._ended)
        infos: dict[str, Any] = {}
        reward = np.zeros(self.num_envs)
        terminated, truncated = np.zeros((2, self.num_envs), dtype=bool)
        result = self.tiles.step(ids, actions[ids]) if len(ids) else None
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
            self._add_descriptions(infos, np.arange(self.num_envs))
            if result is not None:
                self._add_step(infos, ids, result, np.ones(len(ids), dtype=bool))
        return observation, reward, terminated, truncated, infos

    def _same_step(
        self,
        observation: Observation,
        ended: NDArray[np.bool_],
        ids: Index,
        result: Outcome | None,
        infos: dict[str, Any],
    ) -> Observation:
        """Reset what has ended; its last observation and info become `final_obs`, `final_info`."""
        assert result is not None
        over = np.flatnonzero(ended)
        last: dict[str, Any] = {}
        self._add_descriptions(last, over)
        self._add_step(last, ids, result, ended[ids])
        finals = np.full(self.num_envs, None, dtype=object)
        for i in over:
            finals[i] = observation[i].copy()
        infos.update(final_obs=finals, _final_obs=ended.copy())
        infos.update(final_info=last, _final_info=ended.copy())
        self._restart(over, [None] * len(over))
        self._add_descriptions(infos, np.arange(self.num_envs))
        if not ended.all():
            self._add_step(infos, ids, result, ~ended[ids])
        observation[over] = self.tiles.observe(over)
        return observation

    def _add_descriptions(self, infos: dict[str, Any], ids: Index) -> None:
        for name, values in self.tiles.describe(ids).items():
            self._put(infos, name, ids, values)

    def _add_step(
        self, infos: dict[str, Any], ids: Index, step: Outcome, which: NDArray[np.bool_]
    ) -> None:
        """Add what ``step`` of environments ``ids`` says about those of ``which``."""
        for name in self.core.each:
            self._put(infos, name, ids[which], getattr(step, name)[which])
        terms: dict[str, Any] = {}
        for name in self.core.terms:
            self._put(terms, name, ids[which], step.terms[name][which])
        infos["reward_terms"], infos["_reward_terms"] = (
            terms,
            terms[f"_{self.core.terms[0]}"].copy(),
        )
        final = which & (step.terminated | step.truncated)
        if final.any():
            for name in self.core.final:
                self._put(infos, name, ids[final], getattr(step, name)[final])

    def _put(self, infos: dict[str, Any], name: str, ids: Index, values: NDArray[Any]) -> None:
        """Add an info of some environments, with its mask: what `_add_info` makes, at once."""
        fill = None if values.dtype == object else values.dtype.type(0)
        infos[name] = np.full((self.num_envs, *values.shape[1:]), fill, dtype=values.dtype)
        infos[name][ids] = values
        infos[f"_{name}"] = np.zeros(self.num_envs, dtype=bool)
        infos[f"_{name}"][ids] = True

    def render(self) -> Any:
        """Return a tuple with one frame per environment, None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(self._frame(i, self.render_mode) for i in range(self.num_envs))

    def _frame(self, i: int, mode: str) -> Any:
        tile, place = self.tiles.locate(i)
        if tile not in self._renderers:
            self._renderers[tile] = self._make_renderer(self.tiles.cores[tile])
        return self._renderers[tile].frame(place, mode)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the graphics contexts."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()


_ONE = np.zeros(1, dtype=np.int64)


def _first(values: NDArray[Any]) -> Any:
    """Return the first row: a plain number or string, or a fresh array."""
    row = values[0]
    if isinstance(row, np.ndarray):
        return row.copy()
    return row.item() if isinstance(row, np.generic) else row


def _metadata(core: BatchCore) -> dict[str, Any]:
    return {**ArmEnv.metadata, "render_fps": max(1, round(1 / core.interval))}
