"""Fits a joint's parameters to its dithered torques, and carries them over to the whole arm."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from benchmarks.thesis.nested_models.cells import Cell
from stiction_envs.experiments.sje.calibrate import calibrate
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.gap.tables.data import WholeArm
from stiction_envs.gap.tables.predictor import LoneJointTorques
from stiction_envs.measured.thesis_tables import thesis_base, thesis_robots
from stiction_envs.robots import load_arm

Array = NDArray[np.float64]
(ROBOT,) = thesis_robots("4.6")
POPULATION = 14
"""Candidates per seed and generation: 4 + 3 ln(n) rounded up for five parameters, and half more;
assumed."""
ITERATIONS = 2
"""Per cell on the whole arm, without scatter: the second is free of how the first began;
assumed."""
STIFF_BRISTLE = 1e4
"""What stands for no presliding [N·m/rad]: at 1 N·m it yields 0.1 mrad; the bound of 3.4."""
PHYSICAL = (
    ("inertia", "+ rotor inertia", "a band of one level, and the rotor's inertia takes torque"),
    ("presliding", "+ presliding", "bristles and Stribeck: LuGre instead of a band"),
    ("path", "+ torque path", "100 Hz low-pass and 1000 N·m/s on the command"),
    ("elasticity", "+ joint elasticity", "joints 1-4: a spring between rotor and link"),
    ("load", "+ load", "friction of its own in each pose"),
    ("offset", "+ offset", "half-sum of the base torques is bias, which dither leaves alone"),
    ("drift", "+ base drift", "one factor per configuration between measuring days"),
)
"""Effects one after the other: key, name of the model that has it and all before, statement."""
ALL = frozenset(key for key, *_ in PHYSICAL)


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


class JointFit(LoneJointTorques):
    """Cells of one joint, how parameters predict their change of torque, and the loss of that."""

    def __init__(
        self,
        joint: int,
        cells: Sequence[Cell],
        whole: WholeArm,
        effects: frozenset[str] = ALL,
        *,
        correction: Array | None = None,
    ) -> None:
        """Set up the fit.

        Args:
            joint: from 1.
            cells: of that joint; to be fitted, those that may be.
            whole: the arm.
            effects: which physical statements are made, keys of `PHYSICAL`.
            correction: (cells,) what the whole arm predicts more than the lone joint [-].
        """
        super().__init__(joint, whole)
        self._base = thesis_base(ROBOT)
        self.cells, self.effects = list(cells), effects
        self.correction = np.zeros(len(self.cells)) if correction is None else correction
        self.names = ["rotor_inertia"]
        if "presliding" in effects:
            self.names += ["bristle_stiffness", "coulomb_ratio", "stribeck_velocity"]
        if "elasticity" in effects and whole.friction.elastic[joint - 1]:
            self.names.append("joint_stiffness")
        self._bounds = np.log([bounds(n, joint) for n in self.names])
        levels = [self._of(c.configuration) for c in self.cells]
        self._undithered = [(*level, 0.0, 0.0) for level in levels]
        self._dithered = [
            (*level, c.row.frequency_hz, c.row.amplitude_nm)
            for level, c in zip(levels, self.cells, strict=True)
        ]

    def _of(self, where: Configuration) -> tuple[float, float]:
        """Return (stiction [N·m], link inertia [kg·m²]) of a configuration.

        Without ``load`` stiction is the mean of both poses; without ``offset`` each direction's
        base torque is its friction, with it their half-sum is kept apart.
        """
        j, k, d = where.index
        base = self._base
        poses = slice(k, k + 1) if "load" in self.effects else slice(None)
        level = float(self.whole.level[j, poses].mean())
        if "offset" not in self.effects:
            table = np.abs(base.tau[j, poses, d]).mean()
            level *= float(table / base.friction[j, poses].mean())
        return level, float(self.whole.link[j, k])

    def _without(self) -> dict[str, float]:
        """Return the parameters that effects set, whatever is fitted: most stand for their lack."""
        out: dict[str, float] = {}
        if "presliding" not in self.effects:
            out |= {"bristle_stiffness": STIFF_BRISTLE, "coulomb_ratio": 1.0}
        if "elasticity" not in self.effects:
            out |= {"joint_stiffness": np.inf}
        if "path" not in self.effects:
            out |= {"lowpass_hz": np.inf, "torque_rate": np.inf}
        return out

    def predict(self, population: Sequence[Mapping[str, float]]) -> Array:
        """Return (population, cells) predicted change |τ_SJE|/|τ_base| − 1 [-]; NaN: stuck.

        Args:
            population: parameters by name; what is not named is nominal.
        """
        sets = [{**p, **self._without()} for p in population]
        # joints that differ in nothing are simulated once
        columns = sorted({*self._undithered, *self._dithered})
        tau = self.breakaway(columns, sets, None if "path" in self.effects else 1)
        dithered, undithered = (
            tau[:, [columns.index(key) for key in keys]]
            for keys in (self._dithered, self._undithered)
        )
        if "offset" not in self.effects:
            return dithered / undithered - 1.0
        base = [abs(self._base.tau[c.configuration.index]) for c in self.cells]
        return (dithered - undithered) / np.array(base)

    def parameters(self, x: Array) -> dict[str, float]:
        """Return parameters from the unit cube, logarithmic between the bounds."""
        low, high = self._bounds.T
        return dict(zip(self.names, map(float, np.exp(low + (high - low) * x)), strict=True))

    def cube(self, parameters: Mapping[str, float]) -> Array:
        """Return the unit cube from parameters."""
        low, high = self._bounds.T
        x = (np.log([parameters[n] for n in self.names]) - low) / (high - low)
        return np.clip(x, 0.0, 1.0)

    def losses(self, population: Sequence[dict[str, float]]) -> Array:
        """Return (population,) losses."""
        pairs = zip(self.predict(population), population, strict=True)
        return np.array([self.loss(v + self.correction, p) for v, p in pairs])

    def loss(self, predicted: Array, parameters: Mapping[str, float]) -> float:
        """Return absolute errors over noise, plus the cost of drift and of the priors.

        Args:
            predicted: (cells,) changes [-].
            parameters: with which they are predicted.
        """
        if not np.isfinite(predicted).all():
            return 1e3
        noise, total = settings()["noise"], 0.0
        for name, value in parameters.items():
            away = np.log(value / prior(name, self.joint)) / settings()[name]["prior_log_sd"]
            total += float(away**2 / 2)
        measured = np.array([c.change for c in self.cells])
        if "drift" in self.effects:
            factor = drift_factors(self.cells, predicted)
            scale = np.array([factor[c.configuration] for c in self.cells])
            predicted = scale * (1.0 + predicted) - 1.0
            total += sum(((f - 1.0) / noise["drift_sd"]) ** 2 / 2 for f in factor.values())
        return float(total + np.abs(predicted - measured).sum() / noise["cell_sd"])


def drift_factors(cells: Sequence[Cell], predicted: Array) -> dict[Configuration, float]:
    """Return one factor per configuration on its base between measuring days.

    The median over its fitted cells of measured over predicted torque: a base that has moved shifts
    all its dithered torques alike, a single bad reading does not.

    Args:
        cells: measured.
        predicted: (cells,) change [-].
    """
    ratio: dict[Configuration, list[float]] = {}
    for c, p in zip(cells, predicted, strict=True):
        if not c.held_out:
            ratio.setdefault(c.configuration, []).append((1.0 + c.change) / (1.0 + p))
    return {k: float(np.median(v)) for k, v in ratio.items()}


def with_drift(cells: Sequence[Cell], predicted: Array) -> Array:
    """Return predictions (cells,) with the drift that the fitted cells show."""
    factor = drift_factors(cells, predicted)
    return np.array(
        [factor[c.configuration] * (1 + p) - 1 for c, p in zip(cells, predicted, strict=True)]
    )


def search(
    fit: JointFit,
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
    searches = []
    for k, seed in enumerate(seeds):
        rng = np.random.default_rng([seed, fit.joint])
        warm = fit.cube(around) if around is not None and k == 0 else None
        mean = rng.uniform(0.25, 0.75, len(fit.names)) if warm is None else warm
        searches.append(
            CMA(
                mean=mean,
                sigma=0.25 if warm is None else 0.08,
                bounds=np.tile([0.0, 1.0], (len(fit.names), 1)),
                population_size=POPULATION,
                seed=int(rng.integers(2**31)),
            )
        )
    best = [Found(fit.joint, s, np.inf, {}) for s in seeds]
    for _ in range(generations):
        asked = [[s.ask() for _ in range(POPULATION)] for s in searches]
        population = [fit.parameters(x) for xs in asked for x in xs]
        losses = fit.losses(population).reshape(len(seeds), POPULATION)
        for i, (s, xs, values) in enumerate(zip(searches, asked, losses, strict=True)):
            s.tell([(x, float(v)) for x, v in zip(xs, values, strict=True)])
            k = int(values.argmin())
            if values[k] < best[i].loss:
                best[i] = Found(fit.joint, seeds[i], float(values[k]), fit.parameters(xs[k]))
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
    friction: FrictionParameters, chosen: Sequence[Cell]
) -> tuple[FrictionParameters, Array]:
    """Calibrate an arm's levels to Table 4.3 and simulate cells with the plant.

    Args:
        friction: of the arm; its levels are overwritten.
        chosen: cells to simulate.

    Returns:
        Calibrated parameters and (cells,) changes against the simulation's own base torque [-].
    """
    experiment = SingleJointExperiment(ROBOT, friction=friction, scatter=False)
    fitted = calibrate(thesis_base(ROBOT), experiment).parameters
    experiment = experiment.replace(sticking=build(load_arm(ROBOT), fitted))
    jobs = [Job(c.configuration, c.row.frequency_hz, c.row.amplitude_nm) for c in chosen]
    bases = dict.fromkeys(Job(c.configuration) for c in chosen)
    run = experiment.run([*bases, *dict.fromkeys(jobs)], iterations=ITERATIONS)
    tau = {m.job: abs(m.mean) for m in run}
    return fitted, np.array([tau[j] / tau[Job(j.configuration)] - 1.0 for j in jobs])
