"""Objective of the Generated Trajectory Experiment: the error that is left when the arm rests.

The sum of the error over a path, or over the window of Table 4.11, hardly depends on dither: it is
the impedance law's own lag. The error that friction leaves at each goal does. A table of the whole
arm is tried on every path, stiffness and friction:

    value       1/2 (log position left + log orientation left), over no dither, mean of all goals
    constraint  vibration / largest vibration - 1 <= 0, moving and at rest
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from optuna.distributions import BaseDistribution, FloatDistribution

from stiction_envs.arrays import Array
from stiction_envs.control.compensation import Compensation
from stiction_envs.control.laws import LAWS
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.measured.tables import AmplitudeRow
from tuning.search.bounds import Bounds, Table
from tuning.settings import BoundsSettings, tuning_settings
from tuning.study.record import LIMITS, Parameters, TrialOutcome

Place = tuple[str, tuple[float, float, float]]
"""A path by name and its stiffness [N/m, N·m/rad, N·m/rad]."""


@dataclass(frozen=True, kw_only=True)
class Treatment:
    """A measure against friction: dither, compensation, both or nothing."""

    dither: Table = ()
    compensation: Compensation | None = None  # Added to the controller's torque

    def case(self, place: Place) -> Case:
        """Return the case of the experiment."""
        return Case(
            trajectory=place[0],
            stiffness=place[1],
            dither=self.dither,
            compensation=self.compensation,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracking:
    """Results of one treatment at P places under F frictions."""

    errors: tuple[Array, ...]
    """Per place (F, G, 2) error left at each of its goals when the arm's time there is over:
    distance [m] and angle [rad]."""
    vibration: Array  # (P, F) root mean square vibration during the motion, rotation included [m]
    vibration_at_rest: Array  # (P, F) the same after the last goal was reached [m]
    power: Array  # (P, F) power that the dither moves back and forth [W]
    torque_rate: Array  # (P, F) largest change of torque on any joint [N·m/s]

    @property
    def shaking(self) -> tuple[float, float]:
        """Vibration moving and at rest, root mean square over places and frictions [m]."""
        return _rms(self.vibration), _rms(self.vibration_at_rest)

    @property
    def totals(self) -> dict[str, float]:
        """Numbers over all places and frictions, by the names in ``trials.csv``."""
        moving, resting = self.shaking
        return {
            "vibration_m": moving,
            "vibration_at_rest_m": resting,
            "power_w": float(self.power.mean()),
            "torque_rate_nm_s": float(self.torque_rate.max()),
        }

    def left(self, plain: "Tracking") -> tuple[float, float]:
        """Return position and orientation error relative to another treatment, geometric means [-].

        Errors are averaged over frictions before they are compared, so that one that happens to be
        zero does not decide.
        """
        pairs = zip(self.errors, plain.errors, strict=True)
        ratio = np.concatenate([np.log(x.mean(axis=0) / y.mean(axis=0)) for x, y in pairs])
        return float(np.exp(ratio[:, 0].mean())), float(np.exp(ratio[:, 1].mean()))

    def by_friction(self, plain: "Tracking") -> dict[str, Array]:
        """Return errors relative to another treatment per friction, geometric means (F,) [-].

        ``position`` and ``orientation`` are over all goals; ``resting_…`` at the last goal of each
        path, where the arm rests, a second after it was reached.
        """
        ratios = [np.log(x / y) for x, y in zip(self.errors, plain.errors, strict=True)]
        every = np.exp(np.mean([x.mean(axis=1) for x in ratios], axis=0))
        last = np.exp(np.mean([x[:, -1] for x in ratios], axis=0))
        names = ("position", "orientation", "resting_position", "resting_orientation")
        return dict(zip(names, (*every.T, *last.T), strict=True))


class TrackingObjective:
    """Measures treatments of one arm on some paths under some frictions."""

    def __init__(
        self,
        experiment: GeneratedTrajectoryExperiment,
        bounds: Bounds,
        frictions: Sequence[FrictionParameters],
        places: Sequence[Place],
        *,
        iterations: int,
        joints: Sequence[int] = (),
        compensation: str = "none",
        limits: Table = (),
        penalty: float = 0.0,
        pareto: bool = False,
        settings: BoundsSettings | None = None,
        rest_margin: float | None = None,
    ) -> None:
        """Measure the arm without dither, and the vibration that a table causes.

        Args:
            experiment: the arm and its seed.
            bounds: bounds of the search.
            frictions: frictions under which every table is tried.
            places: paths and stiffnesses.
            iterations: repeats per place and friction.
            joints: joints whose dither is searched, from 1.
            compensation: kind to search, or "none"; its gains are those of the friction that the
                controller assumes, times a factor.
            limits: a table whose vibration no other may exceed, where ``bounds`` has none.
            penalty: added to the value per unit of a constraint, for samplers without constraints.
            pareto: whether vibration in motion is a second objective, and no constraint.
            settings: range of the compensation; None for the defaults.
            rest_margin: how much more than an untreated arm any may vibrate at rest [m]; torque
                may then change no faster than with ``limits``, and a push has a load gain.
        """
        self.pareto = pareto
        self.experiment, self.bounds, self.places = experiment, bounds, tuple(places)
        self.frictions, self.iterations = list(frictions), iterations
        self.joints, self.penalty = tuple(joints), penalty
        self._believed = None if compensation == "none" else experiment.compensation(compensation)
        self._varied: dict[str, tuple[float, BaseDistribution]] = {}
        """Start and range of every parameter of the compensation."""
        if self._believed is not None:
            s, law = settings or tuning_settings().bounds, LAWS[compensation]
            factor, reach = s.compensation_factor, s.compensation_reach
            self._varied["compensation"] = float(np.mean(factor)), FloatDistribution(*factor)
            highest = {field.name: field.largest for field in law.fields}
            for name in law.searched:
                usual = self._believed.numbers[name][0]
                most = min(usual * reach, highest[name])
                wide = FloatDistribution(usual / reach, most, log=True)
                self._varied[f"compensation_{name}"] = usual, wide
            if rest_margin is not None and compensation == "push":
                self._varied["compensation_load"] = 0.0, FloatDistribution(0.0, s.compensation_load)
        self.plain = self.measure([Treatment()])[0]
        largest = np.array(bounds.vibration_m)
        shaken = self.plain
        if limits and (rest_margin is not None or np.isnan(largest).any()):
            shaken = self.measure([Treatment(dither=limits)])[0]
            largest = np.where(np.isnan(largest), shaken.shaking, largest)
        self.torque_rate = np.inf
        """Largest change of torque [N·m/s]; inf where there is no limit."""
        if rest_margin is not None:
            largest[1] = np.fmin(largest[1], self.plain.shaking[1] + rest_margin)
            rates = [float(x.torque_rate.max()) for x in (self.plain, shaken)]
            self.torque_rate = max(rates)
        self.vibration = np.where(np.isnan(largest), np.inf, largest)
        """(2,) largest vibration, moving and at rest [m]; inf where there is no limit."""

    # ---- settings ----------------------------------------------------------------------------

    def space(self) -> dict[str, BaseDistribution]:
        """Return the parameters of a table of the whole arm."""
        out: dict[str, BaseDistribution] = {}
        for j in self.joints:
            for name, d in self.bounds.space(j).items():
                out[f"{name}_{j}"] = d
        return out | {name: wide for name, (_, wide) in self._varied.items()}

    def treatment(self, parameters: Parameters) -> Treatment:
        """Return the treatment that parameters of `space` describe."""
        compensation = None
        if self._believed is not None:
            first, *others = self._varied
            n = self._believed.n
            more = {x.removeprefix("compensation_"): (parameters[x],) * n for x in others}
            compensation = self._believed.times(parameters[first]).replace(**more)
        rows = []
        for j in self.joints:
            mine = {name: parameters[f"{name}_{j}"] for name in self.bounds.space(j)}
            rows.append(self.bounds.setting(j, mine))
        return Treatment(dither=tuple(rows), compensation=compensation)

    def parameters(self, table: Table) -> Parameters:
        """Return the parameters of `space` that are nearest to a table."""
        rows = {row.joint: row for row in table}
        out: Parameters = {}
        for j in self.joints:
            row = rows.get(j, AmplitudeRow(j, 0.0, 0.0))
            out |= {f"{name}_{j}": value for name, value in self.bounds.share(row).items()}
        return out | {name: usual for name, (usual, _) in self._varied.items()}

    # ---- measuring ---------------------------------------------------------------------------

    def measure(self, treatments: Sequence[Treatment]) -> list[Tracking]:
        """Try treatments, all in one batch."""
        e = self.experiment
        tried = list(itertools.product(treatments, self.places, self.frictions))
        cases = [treatment.case(place) for treatment, place, _ in tried]
        frictions = [friction for _, _, friction in tried]
        runs = e.run(cases, iterations=self.iterations, parameters=frictions)
        found = [Measures(run, e.protocol, e.motion) for run in runs]
        rows = [
            (
                _rms(m.shaking),
                _rms(m.shaking_at_rest),
                (m.dither_energy / m.duration).mean(),
                m.torque_rate.max(),
            )
            for m in found
        ]
        p, f = len(self.places), len(self.frictions)
        moving, resting, power, rate = np.array(rows).T.reshape(4, len(treatments), p, f)
        left = [m.left.mean(axis=0) for m in found]
        errors = [np.stack(left[k : k + f]) for k in range(0, len(left), f)]
        return [
            Tracking(
                errors=tuple(errors[k * p : (k + 1) * p]),
                vibration=moving[k],
                vibration_at_rest=resting[k],
                power=power[k],
                torque_rate=rate[k],
            )
            for k in range(len(treatments))
        ]

    def evaluate(self, asked: list[tuple[int, Parameters]]) -> list[TrialOutcome]:
        """Return outcomes of tables (0, parameters of `space`)."""
        found = self.measure([self.treatment(parameters) for _, parameters in asked])
        return [self.outcome(one) for one in found]

    def outcome(self, found: Tracking) -> TrialOutcome:
        """Return the stored outcome of a table."""
        position, orientation = found.left(self.plain)
        value = 0.5 * float(np.log(position) + np.log(orientation))
        if not np.isfinite(value):
            return TrialOutcome(values=None)
        # shaken / inf: -1 where there is no limit
        over = [
            float(x / most - 1.0) for x, most in zip(found.shaking, self.vibration, strict=True)
        ]
        constraints = [0.0, 0.0] if self.pareto else over[:]
        if np.isfinite(self.torque_rate):
            over.append(float(found.torque_rate.max()) / self.torque_rate - 1.0)
            constraints.append(over[-1])
        penalised = value + self.penalty * sum(max(c, 0.0) for c in constraints)
        return TrialOutcome(
            values=(penalised, *found.shaking[: self.pareto]),
            constraints=tuple(constraints),
            measures={
                "objective": value,
                "position_left": position,
                "orientation_left": orientation,
                **found.totals,
                LIMITS: over,
            },
        )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
