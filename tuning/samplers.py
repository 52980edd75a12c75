"""Samplers by name; their draws come from (seed, trial number)."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import BaseSampler
from optuna.study import Study
from optuna.trial import FrozenTrial

from stiction_envs.errors import StictionError, unknown
from tuning.record import CONSTRAINTS, Parameters, Space

SAMPLERS = ("gp", "tpe", "cmaes", "random", "grid", "nsga2")


class Fixed(BaseSampler):
    """Proposes one setting that is known beforehand."""

    def __init__(self, setting: Parameters, space: Space) -> None:
        self._setting, self._space = dict(setting), dict(space)

    def infer_relative_search_space(
        self, study: Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """Return the space."""
        return self._space

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> Parameters:
        """Return the setting."""
        return self._setting

    def sample_independent(
        self,
        study: Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> Any:
        """Return one of the setting; Optuna asks so for what has one value only."""
        return self._setting[param_name]


class CmaEsFromTheStart(optuna.samplers.CmaEsSampler):
    """CMA-ES that knows the space, and so draws its first generation about ``x0`` too."""

    def __init__(self, space: Space, **options: Any) -> None:
        super().__init__(**options)
        self._space = dict(space)

    def infer_relative_search_space(
        self, study: Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """Return the space; the base class reads it from trials that are complete."""
        return self._space


class NsgaInOrder(optuna.samplers.NSGAIISampler):
    """NSGA-II whose parents come in the order of their numbers.

    The base class hands them to a generation's first child in the order of their selection and to
    the others, from a cache, by number: a process that goes on within a generation would begin
    with another order.
    """

    def select_parent(self, study: Study, generation: int) -> list[FrozenTrial]:
        """Return the parents of a generation."""
        return sorted(super().select_parent(study, generation), key=lambda t: t.number)


def sampler(
    name: str,
    space: Space,
    *,
    seed: int,
    startup: int,
    population: int = 1,
    points: int = 1,
    first: Parameters | None = None,
    step: float = 0.2,
) -> Callable[[int], BaseSampler]:
    """Return what makes the sampler of a trial, by the trial's number.

    Args:
        name: one of `SAMPLERS`; without PyTorch ``gp`` is ``tpe``, with a warning.
        space: what is searched.
        seed: of all draws.
        startup: trials drawn at random before a model is fitted (gp, tpe).
        population: of cmaes and nsga2.
        points: of a grid, per parameter; trials beyond its cells begin anew.
        first: where cmaes begins; None for the middle.
        step: of cmaes at the beginning, over the range [-].

    Raises:
        StictionError: unknown name, or cmaes without its package.
    """
    if name not in SAMPLERS:
        raise unknown("sampler", name, SAMPLERS)
    if name == "gp" and find_spec("torch") is None:
        warnings.warn("sampler gp needs PyTorch: tpe is used", stacklevel=2)
        name = "tpe"
    if name == "cmaes" and find_spec("cmaes") is None:
        raise StictionError("sampler cmaes: pip install 'stiction-envs[fit]'")
    if name == "grid":
        # Optuna's own goes by trials that are finished, and gives two machines one cell
        cells = _cells(space, points, seed)
        return lambda number: Fixed(cells[number % len(cells)], space)
    make = partial(
        _make,
        name,
        space,
        startup=startup,
        population=population,
        first=first,
        step=step,
    )
    return lambda number: make(int(np.random.SeedSequence([seed, number]).generate_state(1)[0]))


def grid(space: Space, points: int) -> dict[str, list[float]]:
    """Return ``points`` values of every parameter, even on its scale; the low end of one that
    begins at 0 is left out."""
    out: dict[str, list[float]] = {}
    for name, d in space.items():
        if not isinstance(d, FloatDistribution):
            out[name] = list(d.choices)  # type: ignore[attr-defined]
        elif d.log:
            out[name] = [float(x) for x in np.geomspace(d.low, d.high, points)]
        else:
            values = np.linspace(d.low, d.high, points + (d.low == 0))
            out[name] = [float(x) for x in values[int(d.low == 0) :]]
    return out


def _cells(space: Space, points: int, seed: int) -> list[Parameters]:
    """Return the cells of a grid in a random order: a part of them tells of the whole."""
    cells = [
        dict(zip(space, values, strict=True))
        for values in itertools.product(*grid(space, points).values())
    ]
    np.random.default_rng(seed).shuffle(cells)
    return cells


def constraints_of(trial: FrozenTrial) -> list[float]:
    """Return what Optuna asks of a trial: feasible where all are at most 0."""
    return list(trial.user_attrs.get(CONSTRAINTS, ()))


def _make(
    name: str,
    space: Space,
    seed: int,
    *,
    startup: int,
    population: int,
    first: Parameters | None,
    step: float,
) -> BaseSampler:
    seed %= 2**32 - 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        # its successor, Trial.set_constraint, keeps one row per constraint, and a database hands
        # rows back in any order: the GP would take one constraint for another
        warnings.filterwarnings("ignore", "`constraints_func`", FutureWarning)
        # where CMA-ES begins; Optuna 6 wants its users to take it from elsewhere
        warnings.filterwarnings("ignore", "`(x0|sigma0)`", FutureWarning)
        if name == "gp":
            return optuna.samplers.GPSampler(
                seed=seed,
                n_startup_trials=startup,
                deterministic_objective=False,
                constraints_func=constraints_of,
            )
        if name == "tpe":
            return optuna.samplers.TPESampler(
                seed=seed,
                n_startup_trials=startup,
                multivariate=True,
                constraints_func=constraints_of,
            )
        if name == "cmaes":
            return CmaEsFromTheStart(
                space, seed=seed, x0=first, sigma0=step, popsize=population, n_startup_trials=0
            )
        if name == "nsga2":
            return NsgaInOrder(
                seed=seed, population_size=population, constraints_func=constraints_of
            )
        return optuna.samplers.RandomSampler(seed=seed)
