"""Fits a joint's parameters to its dithered torques: CMA-ES from several seeds, all at once."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import missing_extra
from stiction_envs.gap.tables.model import JointTables, drift_factors

Array = NDArray[np.float64]
POPULATION = 14
"""Candidates per seed and generation: 4 + 3 ln(n) rounded up for five parameters, and half more."""


@lru_cache
def settings() -> dict[str, Any]:
    """Return bounds, priors and noise of `dither_fit.toml`."""
    path = Path(__file__).parent / "dither_fit.toml"
    return tomllib.loads(path.read_text(encoding="utf-8"))


def bounds(name: str, joint: int) -> tuple[float, float]:
    """Return the bounds of a parameter of a joint (from 1)."""
    found = settings()[name]["bounds"]
    low, high = found[joint - 1] if isinstance(found[0], list) else found
    return float(low), float(high)


def prior_cost(name: str, joint: int, value: float) -> float:
    """Return minus the log density of a value, up to a constant."""
    entry = settings()[name]
    centre = entry["prior"][joint - 1] if isinstance(entry["prior"], list) else entry["prior"]
    return float((np.log(value / centre) / entry["prior_log_sd"]) ** 2 / 2)


@dataclass(frozen=True)
class Found:
    """Where one seed of the search ended."""

    joint: int
    seed: int
    loss: float
    parameters: dict[str, float]

    @property
    def on_bound(self) -> list[str]:
        """Parameters within 1 % of a bound."""
        return [
            name
            for name, value in self.parameters.items()
            if name in settings()
            and np.abs(np.log(value / np.array(bounds(name, self.joint)))).min() < 0.01
        ]


class Fit:
    """A joint's fitted cells, its free parameters as a unit cube, and the loss over it."""

    def __init__(
        self,
        tables: JointTables,
        *,
        fixed: dict[str, float] | None = None,
        correction: Array | None = None,
    ) -> None:
        """Set up the fit.

        Args:
            tables: of the fitted cells only.
            fixed: parameters that are neither free nor nominal, such as the ramp rate.
            correction: (cells,) what the whole arm predicts more than the lone joint [-].
        """
        self.tables, self.fixed = tables, dict(fixed or {})
        self.correction = np.zeros(len(tables.cells)) if correction is None else correction
        self._bounds = np.log([bounds(n, tables.joint) for n in tables.names])
        noise = settings()["noise"]
        self._cell_sd, self._drift_sd = noise["cell_sd"], noise["drift_sd"]

    def parameters(self, x: Array) -> dict[str, float]:
        """Return parameters from the unit cube, logarithmic between the bounds."""
        low, high = self._bounds.T
        values = np.exp(low + (high - low) * x)
        return dict(zip(self.tables.names, map(float, values), strict=True))

    def cube(self, parameters: dict[str, float]) -> Array:
        """Return the unit cube from parameters."""
        low, high = self._bounds.T
        x = (np.log([parameters[n] for n in self.tables.names]) - low) / (high - low)
        return np.clip(x, 0.0, 1.0)

    def losses(self, population: Sequence[dict[str, float]]) -> Array:
        """Return (population,) absolute errors over noise, plus cost of drift and priors."""
        predicted = self.tables.predict([{**self.fixed, **p} for p in population])
        return np.array(
            [self.loss(v + self.correction, p) for v, p in zip(predicted, population, strict=True)]
        )

    def loss(self, predicted: Array, parameters: Mapping[str, float]) -> float:
        """Return the loss of predicted changes (cells,) [-] made with some parameters."""
        if not np.isfinite(predicted).all():
            return 1e3
        cells = self.tables.cells
        total = sum(prior_cost(n, self.tables.joint, v) for n, v in parameters.items())
        measured = np.array([c.change for c in cells])
        if self.tables.effects.drift:
            factor = drift_factors(cells, predicted, [True] * len(cells))
            scale = np.array([factor[c.configuration] for c in cells])
            predicted = scale * (1.0 + predicted) - 1.0
            total += sum(((f - 1.0) / self._drift_sd) ** 2 / 2 for f in factor.values())
        return float(total + np.abs(predicted - measured).sum() / self._cell_sd)


def optimiser() -> Any:
    """Return the class of CMA-ES searches.

    Raises:
        StictionError: its package is not installed.
    """
    try:
        from cmaes import CMA
    except ImportError:
        raise missing_extra("fitting the thesis's tables", "cmaes", "fit") from None
    return CMA


def search(
    fit: Fit,
    seeds: Sequence[int],
    *,
    generations: int,
    around: dict[str, float] | None = None,
    progress: Callable[[], None] | None = None,
) -> list[Found]:
    """Search from several seeds in lockstep, one simulation for all; best first.

    Args:
        fit: what to fit.
        seeds: one search each.
        generations: of the search.
        around: where the first seed starts; the others, or all if None, start elsewhere.
        progress: called after each generation.
    """
    joint, names, cma = fit.tables.joint, fit.tables.names, optimiser()
    searches = []
    for k, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, joint])
        warm = fit.cube(around) if around is not None and k == 0 else None
        mean = rng.uniform(0.25, 0.75, len(names)) if warm is None else warm
        searches.append(
            cma(
                mean=mean,
                sigma=0.25 if warm is None else 0.08,
                bounds=np.tile([0.0, 1.0], (len(names), 1)),
                population_size=POPULATION,
                seed=int(rng.integers(2**31)),
            )
        )
    best = [Found(joint, s, np.inf, {}) for s in seeds]
    for _ in range(generations):
        asked = [[s.ask() for _ in range(POPULATION)] for s in searches]
        population = [fit.parameters(x) for xs in asked for x in xs]
        losses = fit.losses(population).reshape(len(seeds), POPULATION)
        for i, (s, xs, values) in enumerate(zip(searches, asked, losses, strict=True)):
            s.tell([(x, float(v)) for x, v in zip(xs, values, strict=True)])
            k = int(values.argmin())
            if values[k] < best[i].loss:
                best[i] = Found(joint, seeds[i], float(values[k]), fit.parameters(xs[k]))
        if progress is not None:
            progress()
    return sorted(best, key=lambda f: f.loss)
