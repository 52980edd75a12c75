"""N episodes of one experiment: spaces, actions, how they start, go on and end.

What an experiment has of its own is in its folder's `episodes.py`. The single environment has one
episode, the vector environment as many as it has arms; `envs.gym_env` makes both. Nothing may
depend on how many there are: row i of a batch and a single environment with the same random
generator are the same bits.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.control.sensing import SensingLike, load_sensing
from stiction_envs.dither.waveforms import DEFAULT_WAVEFORM, named
from stiction_envs.errors import StictionError, checked_array
from stiction_envs.experiments.observation import (
    Checked,
    Elements,
    action_bounds,
    observation_bounds,
    observation_names,
)
from stiction_envs.experiments.poses import find_poses
from stiction_envs.experiments.randomise import FIELDS, check_spreads, randomised, true_friction
from stiction_envs.experiments.rig import Experiment, Rig, count_blocks
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.friction.sticking import Friction, check_torque_driven
from stiction_envs.method_settings import Amount, Count, checked
from stiction_envs.method_settings import Index as WholeNumber
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm, load_arm

ScatterKey = tuple[int, ...]  # Seed of the scatter of one episode
Options = Mapping[str, object]  # Options of a reset by name
_ROUNDING = 1e-5  # error of float32 and RescaleAction over an action's range [-]; assumed


Case = TypeVar("Case", bound=Any)  # The case of an episode, such as a configuration of the SJE
Unit = TypeVar("Unit")  # Result of a case without dither: the unit of its reward
Drawn = tuple[list[Case], list[ScatterKey], list[Unit], Array | None]
"""M drawn episodes: cases, seeds of the scatter, units of the reward, factors of friction."""
Own = Any  # an experiment's own: subclass of `Arguments` or `Experiment`, dataclass of weights


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of every environment; the environment's class explains them."""

    robot: str | Path = "panda"
    payload: Sequence[float] | None = None
    tilt: Sequence[float] = (0.0, 0.0)
    chain: Sequence[str] | None = None
    scatter: bool = True
    friction: str | Path | FrictionParameters | None = None
    sensing: SensingLike = "ideal"
    control_interval_s: float = 0.1
    power_weight: float | None = None
    torque_rate_weight: float | None = None
    shaking_weight: float | None = None
    max_episode_steps: int = 1000
    fixed_options: Options | None = None
    randomise: Mapping[str, float] | None = None
    friction_factor: float = 1.0
    waveform: str = DEFAULT_WAVEFORM
    threads: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """Results of one step of M episodes; arrays (M, …)."""

    terms: dict[str, Array]
    """Reward terms by name, as `Episodes.terms` has them."""
    terminated: Bools
    truncated: Bools
    measures: dict[str, NDArray[np.generic]]
    """By the name in the info of every step."""

    @property
    def reward(self) -> Array:
        """(M,) sum of the terms, in their order."""
        return sum(self.terms.values(), start=np.zeros(len(self.terminated)))


class Episodes(ABC, Generic[Case, Unit]):
    """N simulations of an environment that dithers all joints: amplitudes, then frequencies."""

    arguments: ClassVar[type[Arguments]] = Arguments
    """Arguments of the environment."""
    terms: ClassVar[tuple[str, ...]]
    """Terms of the reward, in the order in which they are summed."""
    groups: tuple[Elements, ...]
    """The observation."""
    arms_per_batch: ClassVar[int] = 64
    """Most arms of a batch, see `envs.batches`. Of 1024 arms of the GTE on two cores, batches of 32
    had 0.92 of the speed of batches of 64, batches of 128 0.98, batches of 256 0.85."""

    stiction: Array
    """(n,) unit of the observed torques [N·m]."""
    speed_unit: float = 1.0
    """Unit of the observed speeds [rad/s]."""
    rig: Rig
    """The experiment's machine with all N arms."""

    def __init__(self, num_envs: int, engine_threads: int = 1, **arguments: Any) -> None:
        """Make ``num_envs`` simulations with `Arguments`.

        The engine has ``engine_threads`` threads: several if only these episodes run.
        """
        self._engine_threads = engine_threads
        a = self.arguments(**arguments)
        self.max_episode_steps = checked(a.max_episode_steps, Count, "max_episode_steps")
        checked(a.threads, WholeNumber, "threads")
        self.weights = self._weights(a)
        """Weights of the reward's terms by the name of the argument [-]."""
        self.arm = arm = load_arm(a.robot, payload=a.payload, tilt=a.tilt, chain=a.chain)
        e = self._experiment(a, arm, a.friction)
        check_torque_driven(e.sticking, "environments")
        self._spreads = check_spreads(a.randomise, e.sticking)
        self.experiment = e = e.replace(sensing=load_sensing(arm, a.sensing))
        block = self.block_steps(e)
        blocks = count_blocks("control_interval_s", a.control_interval_s, block * CONTROL_DT)
        self.interval, self.interval_steps = blocks * (block * CONTROL_DT), blocks * block
        self.waveform = named(a.waveform).name  # Waveform of the dither
        self._nominal = e.sticking.parameters
        self._true = true_friction(e.sticking, a.friction_factor)
        self.n, self.num_envs = arm.n, num_envs
        self.fixed_options = self._check_options(a.fixed_options)
        low, high = action_bounds(self._nominal, find_poses(arm), e.interface)
        self.action_space = Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        bounds = observation_bounds(arm.n, self.groups)
        self.observation_space = Box(*bounds, dtype=np.float32)
        self.observation_names = observation_names(arm.n, self.groups)
        self._low = self.action_space.low.astype(float)
        self._high = self.action_space.high.astype(float)
        self.action = np.zeros((num_envs, len(low)))
        self.steps = np.zeros(num_envs, dtype=np.int64)
        self.alive = np.zeros(num_envs, dtype=bool)
        self._make(a)

    # ---- what an experiment defines ----------------------------------------------------------

    @staticmethod
    @abstractmethod
    def reward_settings() -> Own:
        """Return a dataclass with the default of every weight."""

    @abstractmethod
    def _experiment(self, a: Own, arm: Arm, friction: Friction | None) -> Experiment:
        """Return the experiment."""

    @staticmethod
    @abstractmethod
    def block_steps(experiment: Own) -> int:
        """Return the control steps of which a control interval is a multiple."""

    @abstractmethod
    def _make(self, a: Own) -> None:
        """Make the rig and all else that N episodes need; spaces and units are there."""

    @abstractmethod
    def _check_options(self, options: Options | None) -> Checked:
        """Return valid reset options; raise a StictionError for others."""

    @abstractmethod
    def _draw(self, rng: np.random.Generator, options: Checked) -> tuple[Case, ScatterKey]:
        """Return the case of an episode and the seed of its scatter.

        The number of draws from a generator does not depend on the options.
        """

    @abstractmethod
    def _cases(self, options: Checked) -> set[Case]:
        """Return every case that options allow."""

    @abstractmethod
    def _undithered(self, cases: Sequence[Case]) -> Mapping[Case, Unit]:
        """Return the results of cases without dither: the units of their rewards."""

    @abstractmethod
    def _begin(
        self, ids: Index, cases: Sequence[Case], keys: Sequence[ScatterKey], base: Sequence[Unit]
    ) -> None:
        """Put simulations ``ids`` at the start of their cases, not dithered."""

    @abstractmethod
    def _advance(self, ids: Index) -> None:
        """Advance simulations ``ids`` by one interval."""

    @abstractmethod
    def _outcome(self, ids: Index) -> Outcome:
        """Return the results of the step that simulations ``ids`` have just done."""

    @abstractmethod
    def last_measures(self, ids: Index) -> dict[str, NDArray[np.generic]]:
        """Return what only an episode's last info has, of simulations ``ids``, which are over."""

    @abstractmethod
    def _observed(self, ids: Index) -> dict[str, Array]:
        """Return the observations of simulations ``ids`` by group, without the dither."""

    @abstractmethod
    def describe(self, ids: Index) -> dict[str, NDArray[np.generic]]:
        """Return case and options of the episodes of ``ids`` by name of the info: fresh arrays."""

    @staticmethod
    @abstractmethod
    def columns(measures: Mapping[str, Array]) -> dict[str, float]:
        """Return the columns that an episode's last measures fill in a table of evaluations."""

    # ---- episodes ----------------------------------------------------------------------------

    def reset(
        self, ids: Index, rngs: Sequence[np.random.Generator], options: Sequence[Options | None]
    ) -> None:
        """Start an episode in simulations ``ids``, each drawn from its own generator."""
        self.begin(ids, self.draw(rngs, options))

    def draw(
        self, rngs: Sequence[np.random.Generator], options: Sequence[Options | None]
    ) -> Drawn[Case, Unit]:
        """Draw an episode from each generator, and find its result without dither."""
        checked = self.check_reset(options)
        drawn = [self._draw(rng, o) for rng, o in zip(rngs, checked, strict=True)]
        cases, keys = [case for case, _ in drawn], [key for _, key in drawn]
        wanted = set(cases)
        if any(len(self._cases(o)) > 1 for o in checked):
            # further episodes will draw as well: one batch for all is the fastest
            wanted |= self._cases(self.fixed_options)
        base = self._undithered(sorted(wanted))
        # the count of draws does not depend on the spreads
        size = len(FIELDS), self.n
        spread = np.stack([r.uniform(-1.0, 1.0, size) for r in rngs]) if self._spreads else None
        return cases, keys, [base[case] for case in cases], spread

    def begin(self, ids: Index, drawn: Drawn[Case, Unit]) -> None:
        """Start the episodes that were drawn, in simulations ``ids``."""
        cases, keys, base, spread = drawn
        if spread is not None:
            friction = randomised(self._true, self._spreads, spread)
            self.rig.plant.set_friction(ids, friction)
        elif self._true is not self._nominal:
            self.rig.plant.set_friction(ids, self._true.tile(len(ids)))
        self.action[ids] = self._low
        self._begin(ids, cases, keys, base)
        self.steps[ids], self.alive[ids] = 0, True

    def step(self, ids: Index, action: ArrayLike) -> Outcome:
        """Dither simulations ``ids`` with ``action`` (M, 2n) [N·m, Hz] for one control interval."""
        self.action[ids] = self.check_step(ids, action)
        self.rig.retune(self.action[:, : self.n], self.action[:, self.n :])
        self._advance(ids)
        self.steps[ids] += 1
        out = self._outcome(ids)
        self.alive[ids] = ~(out.terminated | out.truncated)
        return out

    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of simulations ``ids``: a fresh array."""
        share = 2.0 * (self.action[ids] - self._low) / (self._high - self._low) - 1.0
        seen = self._observed(ids)
        seen["amplitude"], seen["frequency"] = share[:, : self.n], share[:, self.n :]
        columns = [np.asarray(seen[g.name], dtype=float).reshape(len(ids), -1) for g in self.groups]
        space = self.observation_space
        return np.clip(np.concatenate(columns, axis=1), space.low, space.high).astype(np.float32)

    def prepare(self, options: Sequence[Options | None]) -> None:
        """Find the units of the rewards of all cases that options allow, in one batch."""
        checked = self.check_reset(options)
        distinct = {repr(sorted(o.items())): o for o in checked}
        cases = set().union(*(self._cases(o) for o in distinct.values()))
        self._undithered(sorted(cases))

    def check_reset(self, options: Sequence[Options | None]) -> list[Checked]:
        """Return the options of a reset, fixed ones included; raise for one that does not exist."""
        return [{**self.fixed_options, **self._check_options(o)} for o in options]

    def check_step(self, ids: Index, action: ArrayLike) -> Array:
        """Return the action of a step as float64 within the space; nothing changes.

        Raise a StictionError for an action outside the space, or an episode that is over.
        """
        if not np.all(self.alive[ids]):
            raise StictionError("step: the episode is over or was never started: call reset")
        out = checked_array(action, "action", (len(ids), len(self._low)), finite=False)
        slack = _ROUNDING * (self._high - self._low)
        good = (out >= self._low - slack) & (out <= self._high + slack)
        if not good.all():
            row, k = np.argwhere(~good)[0]
            what, unit = (("amplitude", "N·m"), ("frequency", "Hz"))[k // self.n]
            raise StictionError(
                f"action: {what} of joint {k % self.n + 1} is {out[row, k]:g} {unit}: "
                f"expected {self._low[k]:g} to {self._high[k]:g} {unit}"
            )
        return np.clip(out, self._low, self._high)

    # ---- what experiments use ----------------------------------------------------------------

    def _weights(self, a: Arguments) -> dict[str, float]:
        """Return the weights of the reward; missing weights are the settings'."""
        settings, out = self.reward_settings(), {}
        for name in (f.name for f in fields(settings) if f.name.endswith("_weight")):
            given = getattr(a, name)
            out[name] = checked(getattr(settings, name) if given is None else given, Amount, name)
        return out

    def _penalties(self, ids: Index, share: Array) -> dict[str, Array]:
        """Return the penalties (M,) of the last action, in a step that is ``share`` (M,) of a run.

        Both are means over joints: of (A / A_max)², and of the dither's (2πfA / limit)².
        """
        n = self.n
        amplitude, frequency = self.action[ids, :n], self.action[ids, n:]
        rate = 2 * np.pi * frequency * amplitude / self.arm.limits.torque_rate
        top = self._high[:n]
        power, rates = ((amplitude / top) ** 2).sum(axis=1) / n, (rate**2).sum(axis=1) / n
        return {
            "power": -self.weights["power_weight"] * share * power,
            "torque_rate": -self.weights["torque_rate_weight"] * share * rates,
        }

    def _time(self, ids: Index) -> Array:
        """Return the time (M,) since the episodes of ``ids`` began [s]."""
        return np.asarray(self.rig.step[ids].astype(float) * CONTROL_DT)
