"""Samplers by name; their draws come from (seed, trial number)."""

import itertools
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import BaseSampler
from optuna.study import Study
from optuna.trial import FrozenTrial

from tuning.study.record import CONSTRAINTS, Parameters, Space


def fixed(setting: Parameters) -> BaseSampler:
    """Return a sampler that proposes one listed setting."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        return optuna.samplers.PartialFixedSampler(setting, optuna.samplers.RandomSampler(seed=0))


class CmaEsFromTheStart(optuna.samplers.CmaEsSampler):
    """CMA-ES that knows the space, so that it draws its first generation around ``x0`` too."""

    def __init__(self, space: Space, **options: Any) -> None:
        super().__init__(**options)
        self._space = dict(space)

    def infer_relative_search_space(
        self, study: Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """Return the space; the base class reads it from trials that are complete."""
        return self._space


def installed(name: str) -> str:
    """Return the sampler that runs under a name: without PyTorch ``gp`` is ``tpe``."""
    return "tpe" if name == "gp" and find_spec("torch") is None else name


def sampler(
    name: str,
    space: Space,
    *,
    seed: int,
    startup: int = 0,
    population: int = 1,
    first: Parameters | None = None,
    step: float = 0.2,
) -> Callable[[int], BaseSampler]:
    """Return a function that makes the sampler of a trial from the trial's number.

    Args:
        name: one of `names.SAMPLERS`; if it is not `installed`, another is used, with a warning.
            A grid's settings are `cells`; beyond them it draws at random.
        space: parameters to search.
        seed: seed of all draws.
        startup: as in `SearchSettings`, as are population and step.
        population: trials per generation of cmaes.
        first: start of cmaes; None for the middle.
        step: initial step size of cmaes, over the range [-].
    """
    used = installed(name)
    if used != name:
        warnings.warn(f"sampler {name} needs PyTorch: {used} is used", stacklevel=2)

    def constraints(trial: FrozenTrial) -> list[float]:
        return list(trial.user_attrs.get(CONSTRAINTS, ()))

    def make(seed: int) -> BaseSampler:
        model: dict[str, Any] = {"n_startup_trials": startup, "constraints_func": constraints}
        if used == "gp":
            return optuna.samplers.GPSampler(seed=seed, deterministic_objective=False, **model)
        if used == "tpe":
            return optuna.samplers.TPESampler(seed=seed, multivariate=True, **model)
        if used == "cmaes":
            return CmaEsFromTheStart(
                space, seed=seed, x0=first, sigma0=step, popsize=population, n_startup_trials=0
            )
        return optuna.samplers.RandomSampler(seed=seed)

    def numbered(number: int) -> BaseSampler:
        drawn = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            # its successor, Trial.set_constraint, keeps one row per constraint, and a database
            # returns rows in any order: the GP would mix the constraints up
            warnings.filterwarnings("ignore", "`constraints_func`", FutureWarning)
            # start of CMA-ES; Optuna 6 wants another way to pass it
            warnings.filterwarnings("ignore", "`(x0|sigma0)`", FutureWarning)
            return make(drawn % (2**32 - 1))

    return numbered


def cells(space: Space, points: int, seed: int) -> tuple[Parameters, ...]:
    """Return the cells of a grid in a random order: a part of them represents the whole.

    A parameter has ``points`` values, even on its scale, without a low end of 0.
    """
    values: list[list[Any]] = []
    for d in space.values():
        if not isinstance(d, FloatDistribution):
            values.append(list(d.choices))  # type: ignore[attr-defined]
        elif d.log:
            values.append(np.geomspace(d.low, d.high, points).tolist())
        else:
            even = np.linspace(d.low, d.high, points + (d.low == 0))
            values.append(even[int(d.low == 0) :].tolist())
    out = [dict(zip(space, cell, strict=True)) for cell in itertools.product(*values)]
    np.random.default_rng(seed).shuffle(out)
    return tuple(out)
