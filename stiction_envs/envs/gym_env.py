"""Gymnasium's `Env` and `VectorEnv` of any experiment.

An environment is a class whose docstring is its page and whose ``episodes`` are the experiment's
`Episodes`; see `sje` and `gte`.
"""

import inspect
import pickle
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from stiction_envs.envs.batches import Batches
from stiction_envs.envs.page_parts import whole_page
from stiction_envs.envs.render.arm_scene import Frame
from stiction_envs.envs.render.frames import RENDER_MODES, Renderer, check_render_mode
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.episodes import Episodes, Index, Options, Outcome
from stiction_envs.plant.copies import dumps

Observation = NDArray[np.float32]
Action = NDArray[np.float32]
Info = dict[str, Any]
AnyOptions = Options | Sequence[Options | None] | None
"""Reset options of all environments, or of each."""


class UnexpectedArgument(StictionError, TypeError):
    """An argument that an environment lacks; TorchRL tries some, and waits for a TypeError."""


class _Experiment:
    """The part that a single environment and a batch have in common."""

    episodes: ClassVar[type[Episodes]]
    renderer: ClassVar[type[Renderer] | None] = None
    """A `Renderer` of the episodes; None for an experiment without pictures."""
    core: Episodes
    """Episodes of the environment, or of the first of several batches, whose spaces are equal."""
    _cores: list[Episodes]
    _renderers: dict[int, Renderer]
    """Renderers by the number of their batch."""

    def __init_subclass__(cls) -> None:
        """Show every argument with its default in the signature of a class; complete its page."""
        if not hasattr(cls, "episodes"):
            return
        cls.__doc__ = whole_page(cls.__doc__ or "", cls.episodes)
        known = [
            inspect.Parameter(f.name, inspect.Parameter.KEYWORD_ONLY, default=f.default)
            for f in fields(cls.episodes.arguments)
        ]
        own = list(inspect.signature(cls.__init__).parameters.values())[1:-1]
        cls.__signature__ = inspect.Signature([*own, *known])  # type: ignore[attr-defined]

    @classmethod
    def _check_arguments(cls, given: Iterable[str]) -> None:
        """Raise an `UnexpectedArgument` for a name that is none; it says which one is nearest."""
        names = [f.name for f in fields(cls.episodes.arguments)]
        for name in given:
            if name not in names:
                (near,) = get_close_matches(name, names, n=1, cutoff=0.0)
                raise UnexpectedArgument(
                    f"unexpected keyword argument {name!r}: the nearest is {near!r}, of "
                    f"{', '.join(names)}"
                )

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Name of every element of an observation."""
        return self.core.observation_names

    def _metadata(self) -> dict[str, object]:
        return {
            "render_modes": list(RENDER_MODES),
            "render_fps": max(1, round(1 / self.core.interval)),
        }

    def _frame(self, batch: int, row: int, mode: str) -> Frame | None:
        """Return the frame of the arm in a row of a batch, None in human mode."""
        if self.renderer is None:
            raise StictionError(f"{type(self).__name__} has no pictures: expected no render_mode")
        if batch not in self._renderers:
            self._renderers[batch] = self.renderer(self.core.arm)
        return self._renderers[batch].frame(self._cores[batch], row, mode)

    def close_extras(self, **kwargs: object) -> None:
        """Close the window and free the graphics contexts."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the environment in mid-episode: a copy has no window and continues bit for bit."""
        state = vars(self) | {"_renderers": {}}
        return _loaded, (type(self), dumps(state, [c.rig.plant.batch for c in self._cores]))


class ArmEnv(_Experiment, gymnasium.Env[Observation, Action]):
    """One arm in an experiment as a Gymnasium environment; subclasses say which experiment."""

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # noqa: RUF012

    def __init__(self, *, render_mode: str | None = None, **arguments: Any) -> None:
        """Make the environment; the class explains the arguments."""
        self._check_arguments(arguments)
        check_render_mode(render_mode)
        self.render_mode = render_mode
        self.core = self.episodes(1, **arguments)
        self._cores, self._renderers = [self.core], {}
        self.metadata = self._metadata()
        self.action_space = self.core.action_space
        self.observation_space = self.core.observation_space

    def reset(
        self, *, seed: int | None = None, options: Options | None = None
    ) -> tuple[Observation, Info]:
        """Start an episode; see the class for the options."""
        super().reset(seed=seed)
        self.core.reset(_ONE, [self.np_random], [options])
        self._show()
        return self.core.observe(_ONE)[0], self._describe()

    def _describe(self) -> Info:
        return {name: _first(values) for name, values in self.core.describe(_ONE).items()}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, Info]:
        """Dither with ``action`` [N·m, Hz] for one control interval."""
        step = self.core.step(_ONE, np.asarray(action)[None])
        terminated, truncated = bool(step.terminated[0]), bool(step.truncated[0])
        info = self._describe()
        info |= {name: _first(x) for name, x in step.measures.items()}
        info["reward_terms"] = {name: float(x[0]) for name, x in step.terms.items()}
        if terminated or truncated:
            info |= {name: _first(x) for name, x in self.core.last_measures(_ONE).items()}
        self._show()
        observation = self.core.observe(_ONE)[0]
        return observation, float(step.reward[0]), terminated, truncated, info

    def render(self) -> Frame | None:
        """Return the frame of the present moment, None in human mode."""
        return None if self.render_mode is None else self._frame(0, 0, self.render_mode)

    def _show(self) -> None:
        if self.render_mode == "human":
            self.render()

    def close(self) -> None:
        """Close the window and free the graphics context."""
        self.close_extras()


class ArmVectorEnv(_Experiment, VectorEnv[Observation, Action, NDArray[np.generic]]):
    """N arms in batches, which threads step; infos are Gymnasium's dict of arrays.

    `reset(seed=s)` gives environment i the seed s + i; a list has one seed per environment.
    ``options`` are those of the single environment for all, or one dict per environment;
    ``"reset_mask"`` (bool array) among them resets only some. Episodes that an autoreset starts
    have `fixed_options` only.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        """Make ``num_envs`` environments; the class of the single one explains the arguments.

        ``autoreset_mode`` is `NextStep` (Gymnasium's default), `SameStep` or `Disabled`; the render
        mode `human` is for the single environment.
        """
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = [m.value for m in AutoresetMode]
            raise unknown("autoreset mode", autoreset_mode, modes) from None
        self._check_arguments(arguments)
        check_render_mode(render_mode, batch=True)
        self.render_mode = render_mode
        self.num_envs = num_envs
        self.batches = Batches(self.episodes, num_envs, **arguments)
        self._cores, self._renderers = self.batches.cores, {}
        self.core = self._cores[0]
        self.metadata = {**self._metadata(), "autoreset_mode": self.autoreset_mode}
        self.single_action_space = self.core.action_space
        self.single_observation_space = self.core.observation_space
        self.action_space = batch_space(self.core.action_space, num_envs)
        self.observation_space = batch_space(self.core.observation_space, num_envs)
        self._rngs: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.zeros(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: AnyOptions = None
    ) -> tuple[Observation, Info]:
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
        infos: Info = {}
        self._put(infos, ids, self.batches.describe(ids))
        return self._observe(), infos

    def _targets(self, options: AnyOptions) -> tuple[Index, list[Options | None]]:
        """Return which environments to reset, and the options of every one."""
        if isinstance(options, str):
            raise StictionError("reset options are a str: expected a dict, or a list of dicts")
        if not (options is None or isinstance(options, Mapping)):
            return np.arange(self.num_envs), list(options)
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        mask = np.ones(self.num_envs, dtype=bool) if mask is None else np.asarray(mask)
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise StictionError(
                f"reset_mask: expected a bool array of shape ({self.num_envs},), one True"
            )
        return np.flatnonzero(mask), [options] * self.num_envs

    def _restart(self, ids: Index, options: Sequence[Options | None]) -> None:
        rngs = [rng for i in ids if (rng := self._rngs[i]) is not None]
        self.batches.reset(ids, rngs, options)
        self._ended[ids] = False

    def _observe(self) -> Observation:
        observation: Observation = self.batches.observe(np.arange(self.num_envs))
        return observation

    def step(
        self, actions: Action
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Info]:
        """Step all environments; finished episodes are reset according to `autoreset_mode`."""
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise StictionError(
                f"actions have shape {actions.shape}: expected {self.action_space.shape}"
            )
        waiting = np.flatnonzero(self._ended)
        if len(waiting) and self.autoreset_mode is not AutoresetMode.NEXT_STEP:
            raise StictionError(f"step: the episode of environment {waiting[0]} is over: reset it")
        ids = np.flatnonzero(~self._ended)
        infos: Info = {}
        reward = np.zeros(self.num_envs)
        terminated, truncated = np.zeros((2, self.num_envs), dtype=bool)
        result = self.batches.step(ids, actions[ids]) if len(ids) else None
        if len(waiting):
            self._restart(waiting, [None] * len(waiting))
        if result is not None:
            reward[ids] = result.reward
            terminated[ids], truncated[ids] = result.terminated, result.truncated
        ended = terminated | truncated
        self._ended = ended.copy()
        observation = self._observe()
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        if same_step and result is not None and ended.any():
            observation = self._same_step(observation, ended, ids, result, infos)
        else:
            everyone = np.arange(self.num_envs)
            self._put(infos, everyone, self.batches.describe(everyone))
            if result is not None:
                self._add_step(infos, ids, result, np.ones(len(ids), dtype=bool))
        return observation, reward, terminated, truncated, infos

    def _same_step(
        self,
        observation: Observation,
        ended: NDArray[np.bool_],
        ids: Index,
        result: Outcome,
        infos: Info,
    ) -> Observation:
        """Reset finished episodes; `final_obs` and `final_info` are of their last step."""
        over, everyone = np.flatnonzero(ended), np.arange(self.num_envs)
        last: Info = {}
        self._put(last, over, self.batches.describe(over))
        self._add_step(last, ids, result, ended[ids])
        finals = np.full(self.num_envs, None, dtype=object)
        for i in over:
            finals[i] = observation[i].copy()
        infos.update(final_obs=finals, _final_obs=ended.copy())
        infos.update(final_info=last, _final_info=ended.copy())
        self._restart(over, [None] * len(over))
        self._put(infos, everyone, self.batches.describe(everyone))
        if not ended.all():
            self._add_step(infos, ids, result, ~ended[ids])
        observation[over] = self.batches.observe(over)
        return observation

    def _add_step(self, infos: Info, ids: Index, step: Outcome, which: NDArray[np.bool_]) -> None:
        """Add the infos of a step of environments ``ids``, of those in the mask ``which``."""
        terms: Info = {}
        for into, found in ((infos, step.measures), (terms, step.terms)):
            self._put(into, ids[which], {name: values[which] for name, values in found.items()})
        infos["reward_terms"] = terms
        infos["_reward_terms"] = terms[f"_{self.core.terms[0]}"].copy()
        final = which & (step.terminated | step.truncated)
        if final.any():
            self._put(infos, ids[final], self.batches.last_measures(ids[final]))

    def _put(self, infos: Info, ids: Index, found: Mapping[str, NDArray[np.generic]]) -> None:
        """Add infos of some environments and their masks, as Gymnasium's `_add_info` does."""
        for name, values in found.items():
            fill = None if values.dtype == object else values.dtype.type(0)
            infos[name] = np.full((self.num_envs, *values.shape[1:]), fill, dtype=values.dtype)
            infos[name][ids] = values
            infos[f"_{name}"] = np.zeros(self.num_envs, dtype=bool)
            infos[f"_{name}"][ids] = True

    def render(self) -> tuple[Frame, ...] | None:
        """Return a tuple with one frame per environment, None without a render mode."""
        if self.render_mode is None:
            return None
        rows = [(k, i) for k, core in enumerate(self._cores) for i in range(core.num_envs)]
        frames = [self._frame(*row, self.render_mode) for row in rows]
        return tuple(frame for frame in frames if frame is not None)  # no batch has the mode human


def _loaded(kind: type[_Experiment], pickled: bytes) -> _Experiment:
    out = kind.__new__(kind)
    vars(out).update(pickle.loads(pickled))
    return out


_ONE = np.zeros(1, dtype=np.int64)


def _first(values: NDArray[np.generic]) -> object:
    """Return the first row: a plain number or string, or a fresh array."""
    row = values[0]
    if isinstance(row, np.ndarray):
        return row.copy()
    return row.item() if isinstance(row, np.generic) else row
