"""The thesis's protocol (4.2) as one function: base torques in, final amplitude table out.

    base torques -> frequencies at scale 1.0 -> best frequency per joint -> scales
      -> intermediate (scale x base of each configuration) -> final (largest of the four)
      -> verification, measured again with another seed

Every measurement is kept in an Optuna study, the only record: one study of the base torques, one
per joint of the grid, one of the verification. A trial is a setting of a joint. Its value is the
mean of |τ|/|τ_base| (of |τ| [N·m] in the first) over the joint's four configurations; its user
attributes are the measurements. An interrupted run continues when it is started again; on a
database, several machines can share it.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from optuna.distributions import CategoricalDistribution

from stiction_envs.arrays import Array
from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import (
    DIRECTIONS,
    LOADS,
    Configuration,
    Job,
    Measurement,
    configurations,
)
from stiction_envs.experiments.sje.results import sje_rows
from stiction_envs.measured.csv_text import table_text
from stiction_envs.measured.tables import AmplitudeRow, write_final, write_sje
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.robots.arm_toml import lookup
from stiction_envs.robots.registry import ARMS
from tuning.settings import ThesisSettings, tuning_settings
from tuning.study.record import Parameters, TrialOutcome, TrialSearch
from tuning.study.samplers import cells, sampler
from tuning.study.tuning_run import Progress, TuningRun, counted
from tuning.study.workers import fill

Verified = dict[str, dict[Configuration, Measurement]]
"""Measurements with the intermediate and with the final amplitudes."""
Jobs = Callable[[Parameters], list[Job]]
"""Returns the jobs of a setting, one per configuration of its joint."""


def frequencies_of(robot: str | None, settings: ThesisSettings) -> tuple[float, ...]:
    """Return the frequencies [Hz] to try on a robot: its TOML's, else the settings'."""
    known = ARMS.get(str(robot))
    own = None if known is None else lookup(known.table, "tuning.frequencies_hz")
    return settings.frequencies_hz if own is None else tuple(own)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Choice for one joint, and its basis."""

    row: AmplitudeRow  # Final dither; amplitude 0 if none reduced the torque
    scale: float  # Best amplitude over base torque at that frequency [-]
    intermediate: Array
    """(2, 2) amplitude of each configuration, scale × |base|: [load, no load] × [+, −] [N·m]."""
    reason: str


def final_amplitude(
    intermediate: Array,
    half_width: float,
    *,
    frequency_hz: float,
    torque_rate: float,
    settings: ThesisSettings | None = None,
) -> tuple[float, str]:
    """Return the final amplitude [N·m] of a joint and the reason for it (thesis Table 4.9).

    It is the largest of the four configurations, but no candidate above `cap_half_widths` friction
    half-widths, as the thesis chose by hand for joint 2. It never exceeds the torque-rate limit.

    Args:
        intermediate: amplitudes of the configurations, any shape [N·m].
        half_width: friction half-width of the joint in its freest pose [N·m].
        frequency_hz: dither frequency [Hz].
        torque_rate: limit of the torque rate [N·m/s]; inf for none.
        settings: None for those of ``settings.toml``.
    """
    s = settings or tuning_settings().thesis
    candidates = np.sort(np.abs(np.ravel(intermediate)))[::-1]
    cap = s.cap_half_widths * half_width
    kept = candidates[candidates <= cap]
    if len(kept) == len(candidates):
        amplitude, reason = float(candidates[0]), "largest of the four configurations"
    elif len(kept):
        amplitude = float(kept[0])
        reason = f"largest of the four up to {cap:.3f} N·m; {candidates[0]:.3f} N·m was dropped"
    else:
        amplitude, reason = float(cap), f"capped at {cap:.3f} N·m, all four were above"
    fastest = torque_rate / (2 * np.pi * frequency_hz)
    if amplitude > fastest:
        amplitude = float(fastest)
        reason = f"limited to {fastest:.3f} N·m by the torque rate of {torque_rate:.0f} N·m/s"
    return amplitude, reason


@dataclass(kw_only=True, eq=False)
class ThesisTuner:
    """One run of the protocol in an output folder."""

    experiment: SingleJointExperiment
    run: TuningRun
    frequencies: tuple[float, ...]  # Frequencies to try [Hz]
    scales: tuple[float, ...]  # Amplitude over base torque [-]
    iterations: int | None
    progress: Progress
    settings: ThesisSettings
    base: dict[Configuration, Measurement] = field(default_factory=dict)
    cells: dict[Job, Measurement] = field(default_factory=dict)

    @property
    def out(self) -> Path:
        """The output folder."""
        return self.run.folder.path

    @property
    def eligible(self) -> tuple[float, ...]:
        """Frequencies that may be chosen [Hz]: those below half the controller's rate.

        The others alias to a constant offset or to ±A sin φ, whose effect depends on φ by chance:
        that is not dither. They are still measured, as the thesis did on the iiwa (sources.md 2.6).
        """
        half = self.experiment.interface.controller_rate_hz / 2
        return tuple(f for f in self.frequencies if f < half) or self.frequencies

    def job(self, c: Configuration, frequency: float, scale: float) -> Job:
        """Return the job of a configuration at a frequency [Hz], A = scale × |base|."""
        return Job(c, frequency, scale * abs(self.base[c].mean))

    def left(self, joint: int, frequency: float, scale: float) -> float:
        """Return the mean |τ|/|τ_base| of a cell of the grid [-]; NaN if a configuration stuck."""
        cs = configurations(self.experiment.n, [joint])
        return self._mean_size([self.cells[self.job(c, frequency, scale)] for c in cs])

    def measure_base(self) -> None:
        """Measure the base torques of all configurations; write base.csv."""
        n = self.experiment.n
        joints = {"joint": CategoricalDistribution(range(1, n + 1))}

        def jobs(setting: Parameters) -> list[Job]:
            return [Job(c) for c in configurations(n, [setting["joint"]])]

        found = self._measure("base", {"base": jobs}, joints, n)
        self.base = {j.configuration: found[j] for j in self.experiment.jobs()}
        for c, m in self.base.items():
            if m.is_stuck:
                raise ExperimentError(
                    f"joint {c.joint}, {c.load}, {c.direction}: stuck without dither at "
                    f"{self.experiment.protocol.give_up_factor:g} times its stiction"
                )
        self._write("base.csv", [])

    def measure_grid(self) -> None:
        """Measure every frequency at every scale and at 1.0; write frequency.csv and scale.csv."""
        n = self.experiment.n
        space = {
            "frequency_hz": CategoricalDistribution(self.frequencies),
            "scale": CategoricalDistribution(sorted({1.0, *self.scales})),
        }

        def jobs(joint: int, cell: Parameters) -> list[Job]:
            of_joint = configurations(n, [joint])
            return [self.job(c, cell["frequency_hz"], cell["scale"]) for c in of_joint]

        grids = {f"joint{j}": partial(jobs, j) for j in range(1, n + 1)}
        self.cells = self._measure("grid", grids, space, self.settings.batch)
        for name, scales in (("frequency.csv", (1.0,)), ("scale.csv", self.scales)):
            every = itertools.product(configurations(n), self.frequencies, scales)
            self._write(name, [self.cells[self.job(*one)] for one in every])

    def choose(self) -> list[Choice]:
        """Return the final choice of every joint; write final.csv and final.yaml.

        It is the frequency with the lowest mean |τ|/|τ_base| at scale 1.0, then the best scale.
        Under position servos final_command.csv has the amplitudes of the commanded angle.
        """
        choices = []
        for joint, rate in enumerate(self.experiment.interface.torque_rate, 1):
            real = {f: self.left(joint, f, 1.0) for f in self.eligible}
            best = _lowest(real, otherwise=self.eligible[-1])
            mine = {x: self.left(joint, best, x) for x in self.scales}
            scale = _lowest(mine, otherwise=1.0)
            tau = np.array(
                [[self.base[Configuration(joint, x, d)].mean for d in DIRECTIONS] for x in LOADS]
            )
            intermediate = scale * np.abs(tau)
            amplitude, reason = final_amplitude(
                intermediate,
                float(((tau[:, 0] - tau[:, 1]) / 2).min()),
                frequency_hz=best,
                torque_rate=float(rate),
                settings=self.settings,
            )
            if not mine.get(scale, np.nan) < 1.0:
                amplitude, reason = 0.0, "no dither lowered the torque"
            row = AmplitudeRow(joint, best, amplitude)
            choices.append(Choice(row=row, scale=scale, intermediate=intermediate, reason=reason))
        names = self.experiment.sticking.arm.joint_names
        write_final(self.out, [c.row for c in choices], names)
        if self.experiment.servos is not None:
            rows = [(c.row.joint, c.row.frequency_hz, self.angle(c)) for c in choices]
            text = table_text(("joint", "frequency_hz", "amplitude_rad"), rows)
            write_text_atomic(self.out / "final_command.csv", text)
        return choices

    def angle(self, choice: Choice) -> float:
        """Return the amplitude [rad] of a dither on the command of a position servo."""
        assert self.experiment.servos is not None
        row = choice.row
        return float(row.amplitude_nm / self.experiment.servos.stiffness[row.joint - 1])

    def verify(self, choices: list[Choice]) -> Verified:
        """Measure intermediate and final amplitudes with another seed; write both tables."""
        n = self.experiment.n
        chosen = {c: choices[c.joint - 1] for c in configurations(n)}
        tables = {
            "intermediate": {
                c: Job(c, x.row.frequency_hz, float(x.intermediate[c.index[1:]]))
                for c, x in chosen.items()
            },
            "final": {c: Job.of(c, x.row) for c, x in chosen.items()},
        }

        def jobs(setting: Parameters) -> list[Job]:
            return [tables[setting["table"]][c] for c in configurations(n, [setting["joint"]])]

        space = {
            "joint": CategoricalDistribution(range(1, n + 1)),
            "table": CategoricalDistribution(tuple(tables)),
        }
        unseen = self.experiment.replace(seed=self.experiment.seed + 1)
        found = self._measure("verification", {"verification": jobs}, space, 2 * n, unseen)
        out = {name: {c: found[job] for c, job in table.items()} for name, table in tables.items()}
        self._write("intermediate.csv", out["intermediate"].values())
        self._write("verification.csv", out["final"].values())
        return out

    def _measure(
        self,
        stage: str,
        grids: Mapping[str, Jobs],
        space: dict[str, CategoricalDistribution],
        batch: int,
        experiment: SingleJointExperiment | None = None,
    ) -> dict[Job, Measurement]:
        """Fill the studies of a stage, by name; return the measurements of all their trials.

        Each study is a whole grid in ``space``: each cell occurs once, in an order from the seed.
        """
        experiment = experiment or self.experiment
        every = cells(space, 1, self.experiment.seed)
        searches = [
            TrialSearch(
                record=self.run.record(name),
                space=space,
                sampler=sampler("grid", space, seed=self.experiment.seed),
                evaluations=len(every),
                batch=batch,
                first=every,
            )
            for name in grids
        ]
        jobs = list(grids.values())
        due = [
            job
            for s, jobs_of in zip(searches, jobs, strict=True)
            for setting in every[len(s.record.trials) :]
            for job in jobs_of(setting)
        ]
        report = counted(self.progress, stage, experiment.expected_seconds(due, self.iterations))

        def evaluate(wanted: list[tuple[int, Parameters]]) -> list[TrialOutcome]:
            groups = [jobs[k](setting) for k, setting in wanted]
            distinct = list(dict.fromkeys(j for group in groups for j in group))
            run = experiment.run(distinct, iterations=self.iterations, progress=report)
            measured = {m.job: m for m in run}
            return [self._outcome([measured[j] for j in group]) for group in groups]

        fill(searches, evaluate)
        return {
            job: _measurement(job, t.user_attrs[_key(job.configuration)])
            for s, jobs_of in zip(searches, jobs, strict=True)
            for t in s.record.trials
            for job in jobs_of(t.params)
        }

    def _mean_size(self, measured: list[Measurement]) -> float:
        """Return the mean |τ|/|τ_base| [-], or |τ| [N·m] before base torques were measured."""
        base = self.base
        taus = [m.mean / base[m.job.configuration].mean if base else m.mean for m in measured]
        return float(np.mean(np.abs(taus)))

    def _outcome(self, measured: list[Measurement]) -> TrialOutcome:
        """Return the stored outcome of a setting; values are None if a joint stuck."""
        value = self._mean_size(measured)
        return TrialOutcome(
            values=(value,) if np.isfinite(value) else None,
            measures={_key(m.job.configuration): m.tau.tolist() for m in measured},
        )

    def _write(self, name: str, measurements: Iterable[Measurement]) -> None:
        """Write a table of measurements, without those of joints that stuck."""
        rows = sje_rows([*self.base.values(), *measurements], self.experiment.sticking.arm.name)
        write_sje(self.out / name, [r for r in rows if r.is_base == (name == "base.csv")])


def _key(c: Configuration) -> str:
    """Return the name of the user attribute of a trial with a configuration's results."""
    return f"{c.load}{c.direction}"


def _measurement(job: Job, tau: list[float]) -> Measurement:
    """Return the measurement of a job from its stored torques [N·m], which are all that is used."""
    none = np.empty(0)
    return Measurement(
        job=job,
        tau=np.array(tau, dtype=float),
        start=none,
        start_torque=none,
        shaken_speed=none,
        traces=(),
        trace_dt=0.0,
    )


def _lowest(values: Mapping[float, float], *, otherwise: float) -> float:
    """Return the key of the lowest number, the lower of equals; ``otherwise`` if all are NaN."""
    numbers = {x: v for x, v in values.items() if np.isfinite(v)}
    return min(numbers, key=lambda x: (numbers[x], x), default=otherwise)


def change(m: Measurement, base: Measurement) -> float:
    """Return the change of |τ| against the base, per cent; negative is less torque."""
    return 100.0 * (abs(m.mean) / abs(base.mean) - 1.0)
