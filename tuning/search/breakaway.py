"""Objective of the Single Joint Experiment: torque left to move a joint, and its oscillation.

A setting of one joint is measured in its four configurations under every friction:

    value       mean of |tau| / |tau_base|
    constraint  displacement / largest displacement - 1 <= 0
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np
from scipy import stats

from stiction_envs.arrays import Array
from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job, Measurement, configurations
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.measured.tables import AmplitudeRow
from tuning.search.bounds import Bounds
from tuning.study.record import LIMITS, Parameters, TrialOutcome


@dataclass(frozen=True, kw_only=True, eq=False)
class Breakaway:
    """Result of one setting of one joint."""

    tau: Array  # (frictions, 4) torque at which the joint breaks away in every configuration [N·m]
    ratio: Array
    """(frictions, 4) |tau| / |tau_base| of every configuration [-]; NaN where the joint stuck."""
    oscillation: Array  # (frictions, 4) root mean square oscillation before breakaway [rad]

    @property
    def displacement(self) -> float:
        """Root mean square of the oscillation over frictions and configurations [rad]."""
        return float(np.sqrt(np.mean(np.square(self.oscillation))))

    @property
    def left(self) -> float:
        """Mean share of the base torque that is left [-]."""
        return float(self.ratio.mean())

    @property
    def reduction(self) -> tuple[float, float, float]:
        """Mean reduction and its 95 % interval over frictions [-]."""
        return interval(1.0 - self.ratio.mean(axis=1))


def interval(values: Array) -> tuple[float, float, float]:
    """Return mean and 95 % interval of the mean (Student's t); NaN bounds of a single value."""
    mean, n = float(np.mean(values)), len(values)
    if n < 2:
        return mean, float("nan"), float("nan")
    half = float(stats.t.ppf(0.975, n - 1) * np.std(values, ddof=1) / np.sqrt(n))
    return mean, mean - half, mean + half


class BreakawayObjective:
    """Measures settings of single joints on one arm under some frictions."""

    def __init__(
        self,
        experiment: SingleJointExperiment,
        bounds: Bounds,
        frictions: Sequence[FrictionParameters],
        *,
        iterations: int,
        limits: Sequence[AmplitudeRow] = (),
        pareto: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        """Measure the base torques.

        Args:
            experiment: the arm and its seed.
            bounds: bounds of the search.
            frictions: frictions under which every setting is measured.
            iterations: repeats per configuration and friction.
            limits: a table whose displacement no setting may pass, where ``bounds`` has none.
            pareto: whether displacement is a second objective, and no constraint.
            progress: called with simulated seconds.
        """
        self.bounds, self.iterations, self.progress = bounds, iterations, progress
        self.pareto = pareto
        arm, timestep = experiment.sticking.arm, experiment.sticking.timestep
        self.experiments = [
            experiment.replace(sticking=build(arm, p, timestep=timestep)) for p in frictions
        ]
        self.n = experiment.n
        runs = self._run(experiment.jobs())
        self.base = [{job.configuration: m for job, m in run.items()} for run in runs]
        for c, m in (one for base in self.base for one in base.items()):
            if m.is_stuck:
                raise ExperimentError(
                    f"joint {c.joint}, {c.load}, {c.direction}: stuck without dither"
                )
        self._limits = {r.joint: r for r in limits if r.amplitude_nm > 0}

    @cached_property
    def displacement(self) -> Array:
        """(n,) largest displacement of each joint [rad]; inf where there is no limit."""
        out = self.bounds.displacement_rad.copy()
        rows = [row for j, row in self._limits.items() if np.isnan(out[j - 1])]
        for row, found in self.measure(rows).items():
            out[row.joint - 1] = found.displacement
        out[np.isnan(out)] = np.inf
        return out

    def measure(self, rows: Sequence[AmplitudeRow]) -> dict[AmplitudeRow, Breakaway]:
        """Measure settings, all in one batch per friction."""
        jobs = {row: [Job.of(c, row) for c in configurations(self.n, [row.joint])] for row in rows}
        found = self._run(list(dict.fromkeys(job for group in jobs.values() for job in group)))
        out = {}
        for row, group in jobs.items():
            tau = np.array([[f[job].mean for job in group] for f in found])
            base = np.array([[b[job.configuration].mean for job in group] for b in self.base])
            out[row] = Breakaway(
                tau=tau,
                ratio=np.abs(tau / base),
                oscillation=np.array([[f[job].displacement for job in group] for f in found]),
            )
        return out

    def _run(self, jobs: list[Job]) -> list[dict[Job, Measurement]]:
        """Measure jobs under every friction."""
        repeats, report = self.iterations, self.progress
        runs = [e.run(jobs, iterations=repeats, progress=report) for e in self.experiments]
        return [{m.job: m for m in run} for run in runs]

    def evaluate(self, asked: list[tuple[int, Parameters]]) -> list[TrialOutcome]:
        """Return outcomes of settings (joint from 0, parameters of `Bounds.space`)."""
        rows = [self.bounds.setting(j + 1, parameters) for j, parameters in asked]
        found = self.measure(rows)
        return [self.outcome(row, found[row]) for row in rows]

    def outcome(self, row: AmplitudeRow, found: Breakaway) -> TrialOutcome:
        """Return the stored outcome of a setting."""
        shaken = float(
            found.displacement / self.displacement[row.joint - 1] - 1.0
        )  # -1 where there is no limit
        rate = 2 * np.pi * row.frequency_hz * row.amplitude_nm
        price = (found.displacement,) if self.pareto else ()
        return TrialOutcome(
            values=(found.left, *price) if np.isfinite(found.left) else None,
            constraints=(0.0 if self.pareto else shaken,),
            measures={
                **asdict(row),
                "left": found.left,
                "displacement_rad": found.displacement,
                # apparent power, rms torque times rms speed: the motion is not in phase
                "power_w": rate * found.displacement / np.sqrt(2),
                "torque_rate_nm_s": rate,
                "tau": found.tau.tolist(),
                "ratio": found.ratio.tolist(),
                LIMITS: [shaken],
            },
        )
