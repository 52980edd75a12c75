"""Fits a joint's parameters to its dithered torques, and carries them over to the whole arm."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.thesis.nested_models.cells import Cell
from benchmarks.thesis.nested_models.joint_tables import JointTables, drift_factors
from stiction_envs.errors import missing_extra
from stiction_envs.experiments.sje.calibrate import calibrate
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.measured import thesis_base, thesis_robots
from stiction_envs.robots import load_arm

Array = NDArray[np.float64]
(ROBOT,) = thesis_robots("4.6")
POPULATION = 14
"""Candidates per seed and generation: 4 + 3 ln(n) rounded up for five parameters, and half more;
assumed."""
ITERATIONS = 2
"""Per cell on the whole arm, without scatter: the second is free of how the first began;
assumed."""


@lru_cache
def settings() -> dict[str, Any]:
    """Return bounds, priors and noise of `dither_fit.toml`."""
    return tomllib.loads(Path(__file__).with_name("dither_fit.toml").read_text(encoding="utf-8"))


def bounds(name: str, joint: int) -> tuple[float, float]:
    """Return the bounds of a parameter of a joint (from 1)."""
    found = settings()[name]["bounds"]
    low, high = found[joint - 1] if isinstance(found[0], list) else found
    return float(low), float(high)


def prior(name: str, joint: int) -> float:
    """Return the centre of a parameter's prior, of a joint (from 1)."""
    centre = settings()[name]["prior"]
    return float(centre[joint - 1] if isinstance(centre, list) else centre)


def prior_cost(name: str, joint: int, value: float) -> float:
    """Return minus the log density of a value, up to a constant."""
    return float((np.log(value / prior(name, joint)) / settings()[name]["prior_log_sd"]) ** 2 / 2)


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
        cells, noise = self.tables.cells, settings()["noise"]
        total = sum(prior_cost(n, self.tables.joint, v) for n, v in parameters.items())
        measured = np.array([c.change for c in cells])
        if self.tables.effects.drift:
            factor = drift_factors(cells, predicted, [True] * len(cells))
            scale = np.array([factor[c.configuration] for c in cells])
            predicted = scale * (1.0 + predicted) - 1.0
            total += sum(((f - 1.0) / noise["drift_sd"]) ** 2 / 2 for f in factor.values())
        return float(total + np.abs(predicted - measured).sum() / noise["cell_sd"])


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
) -> list[Found]:
    """Search from several seeds in lockstep, one simulation for all; best first.

    Args:
        fit: what to fit.
        seeds: one search each.
        generations: of the search.
        around: where the first seed starts; the others, or all if None, start elsewhere.
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
    return sorted(best, key=lambda f: f.loss)


# ---- the whole arm -------------------------------------------------------------------------------


def start_friction() -> FrictionParameters:
    """Return the friction from which every fit starts: the priors' centres, not the shipped ones.

    Damping ratios, viscous friction and ripple are the robot's file's; levels are still to be
    calibrated.
    """
    shipped = load_friction(ROBOT)
    changes = {}
    for name, entry in settings().items():
        if "prior" in entry:
            centre = np.broadcast_to(np.array(entry["prior"], dtype=float), (shipped.n,))
            both = getattr(shipped, name).ndim == 2
            changes[name] = np.repeat(centre[:, None], 2, axis=1) if both else centre.copy()
    return shipped.replace(**changes)


def with_parameters(
    friction: FrictionParameters, found: Mapping[int, Mapping[str, float]]
) -> FrictionParameters:
    """Return friction with the named parameters of some joints (from 1) replaced."""
    changes = {}
    for name in dict.fromkeys(n for p in found.values() for n in p):
        value = np.array(getattr(friction, name))
        for joint, parameters in found.items():
            if name in parameters:
                value[joint - 1] = parameters[name]
        changes[name] = value
    return friction.replace(**changes)


def whole_arm(
    friction: FrictionParameters, chosen: Sequence[Cell], ramp_rate: float | None = None
) -> tuple[FrictionParameters, Array]:
    """Calibrate an arm's levels to Table 4.3 and simulate cells with the plant.

    Args:
        friction: of the arm; its levels are overwritten.
        chosen: cells to simulate.
        ramp_rate: [N·m/s], None for the protocol's.

    Returns:
        Calibrated parameters and (cells,) changes against the simulation's own base torque [-].
    """
    experiment = SingleJointExperiment(ROBOT, friction=friction, scatter=False)
    if ramp_rate is not None:
        protocol = experiment.protocol.replace(ramp_rate=ramp_rate)
        experiment = experiment.replace(protocol=protocol)
    fitted = calibrate(thesis_base(ROBOT), experiment).parameters
    experiment = experiment.replace(sticking=build(load_arm(ROBOT), fitted))
    jobs = [Job(c.configuration, c.row.frequency_hz, c.row.amplitude_nm) for c in chosen]
    bases = dict.fromkeys(Job(c.configuration) for c in chosen)
    run = experiment.run([*bases, *dict.fromkeys(jobs)], iterations=ITERATIONS)
    tau = {m.job: abs(m.mean) for m in run}
    return fitted, np.array([tau[j] / tau[Job(j.configuration)] - 1.0 for j in jobs])
