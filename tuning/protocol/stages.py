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

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
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

Cell = tuple[float, float]
"""Frequency [Hz] and scale [-]."""
Verified = dict[str, dict[Configuration, Measurement]]
"""Measurements with the intermediate and with the final amplitudes."""
Jobs = Callable[[int, Parameters], list[Job]]
"""Jobs of a setting of a search (given by number), one per configuration of its joint."""


def frequencies_of(robot: str | None, settings: ThesisSettings) -> tuple[float, ...]:
    """Return the frequencies [Hz] to try on a robot: its TOML's, else the settings'."""
    known = ARMS.get(str(robot))
    own = None if known is None else lookup(known.table, "tuning.frequencies_hz")
    return settings.frequencies_hz if own is None else tuple(own)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Choice for one joint, and its basis."""

    row: AmplitudeRow
    """Final dither; amplitude 0 if none reduced the torque."""
    scale: float
    """Best amplitude over base torque at that frequency [-]."""
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
    frequencies: tuple[float, ...]
    """Frequencies to try [Hz]."""
    scales: tuple[float, ...]
    """Amplitude over base torque [-]."""
    iterations: int | None
    progress: Progress
    settings: ThesisSettings
    base: dict[Configuration, Measurement] = field(default_factory=dict)
    cells: dict[Job, Measurement] = field(default_factory=dict)
    ratios: list[dict[Cell, float]] = field(default_factory=list)
    """Mean |τ|/|τ_base| of every joint's cells in which no configuration stuck [-]."""

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

    def measure_base(self) -> None:
        """Measure the base torques of all configurations; write base.csv."""
        n = self.experiment.n
        joints = {"joint": CategoricalDistribution(range(1, n + 1))}

        def jobs(_: int, setting: Parameters) -> list[Job]:
            return [Job(c) for c in configurations(n, [setting["joint"]])]

        found = self._measure("base", [self._search("base", joints, n)], jobs, self.experiment)
        self.base = {j.configuration: found[j] for j in self.experiment.jobs()}
        for c, m in self.base.items():
            if not np.isfinite(m.mean):
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
        joints = range(1, n + 1)
        searches = [self._search(f"joint{j}", space, self.settings.batch) for j in joints]

        def jobs(k: int, cell: Parameters) -> list[Job]:
            return [
                self.job(c, cell["frequency_hz"], cell["scale"]) for c in configurations(n, [k + 1])
            ]

        self.cells = self._measure("grid", searches, jobs, self.experiment)
        self.ratios = [
            {
                (t.params["frequency_hz"], t.params["scale"]): t.values[0]
                for t in s.record.trials
                if t.values is not None
            }
            for s in searches
        ]
        for name, scales in (("frequency.csv", (1.0,)), ("scale.csv", self.scales)):
            shown = [
                self.job(c, f, s)
                for c in configurations(n)
                for f in self.frequencies
                for s in scales
            ]
            self._write(name, [self.cells[j] for j in dict.fromkeys(shown)])

    def choose(self) -> list[Choice]:
        """Return the final choice of every joint; write final.csv and final.yaml.

        It is the frequency with the lowest mean |τ|/|τ_base| at scale 1.0, then the best scale.
        Under position servos final_command.csv has the amplitudes of the commanded angle.
        """
        choices = []
        rates = self.experiment.interface.torque_rate
        for joint, ratios in enumerate(self.ratios, 1):
            real = {f: v for (f, x), v in ratios.items() if x == 1.0 and f in self.eligible}
            best = min(real, key=lambda f: (real[f], f)) if real else self.eligible[-1]
            mine = {x: v for (f, x), v in ratios.items() if f == best and x in self.scales}
            scale = min(mine, key=lambda x: (mine[x], x)) if mine else 1.0
            tau = np.array(
                [[self.base[Configuration(joint, x, d)].mean for d in DIRECTIONS] for x in LOADS]
            )
            intermediate = scale * np.abs(tau)
            amplitude, reason = final_amplitude(
                intermediate,
                float(((tau[:, 0] - tau[:, 1]) / 2).min()),
                frequency_hz=best,
                torque_rate=float(rates[joint - 1]),
                settings=self.settings,
            )
            if mine.get(scale, np.inf) >= 1.0:
                amplitude, reason = 0.0, "no dither lowered the torque"
            choices.append(
                Choice(
                    row=AmplitudeRow(joint, best, amplitude),
                    scale=scale,
                    intermediate=intermediate,
                    reason=reason,
                )
            )
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

        def jobs(_: int, setting: Parameters) -> list[Job]:
            choice = choices[setting["joint"] - 1]
            row, cs = choice.row, configurations(n, [setting["joint"]])
            if setting["table"] == "final":
                return [Job.of(c, row) for c in cs]
            return [Job(c, row.frequency_hz, float(choice.intermediate[c.index[1:]])) for c in cs]

        tables = ("intermediate", "final")
        space = {
            "joint": CategoricalDistribution(range(1, n + 1)),
            "table": CategoricalDistribution(tables),
        }
        search = self._search("verification", space, 2 * n)
        unseen = self.experiment.replace(seed=self.experiment.seed + 1)
        found = self._measure("verification", [search], jobs, unseen)
        out = {
            table: {
                job.configuration: found[job]
                for joint in range(1, n + 1)
                for job in jobs(0, {"joint": joint, "table": table})
            }
            for table in tables
        }
        self._write("intermediate.csv", out["intermediate"].values())
        self._write("verification.csv", out["final"].values())
        return out

    def _search(
        self, name: str, space: dict[str, CategoricalDistribution], batch: int
    ) -> TrialSearch:
        """Return the search of a whole grid; each cell occurs once, in an order from the seed."""
        every = cells(space, 1, self.experiment.seed)
        return TrialSearch(
            record=self.run.record(name),
            space=space,
            sampler=sampler("grid", space, seed=self.experiment.seed),
            evaluations=len(every),
            batch=batch,
            first=every,
        )

    def _measure(
        self,
        stage: str,
        searches: Sequence[TrialSearch],
        jobs: Jobs,
        experiment: SingleJointExperiment,
    ) -> dict[Job, Measurement]:
        """Fill the studies of a stage; return the measurements of all their trials."""
        settings = ((k, x) for k, s in enumerate(searches) for x in s.first[len(s.record.trials) :])
        due = [job for k, setting in settings for job in jobs(k, setting)]
        total = experiment.expected_seconds(due, self.iterations)
        report = counted(self.progress, stage, total)

        def evaluate(wanted: list[tuple[int, Parameters]]) -> list[TrialOutcome]:
            groups = [jobs(k, setting) for k, setting in wanted]
            distinct = list(dict.fromkeys(j for group in groups for j in group))
            run = experiment.run(distinct, iterations=self.iterations, progress=report)
            measured = {m.job: m for m in run}
            return [self._outcome([measured[j] for j in group]) for group in groups]

        fill(searches, evaluate)
        return {
            job: _measurement(job, t.user_attrs[_key(job.configuration)])
            for k, s in enumerate(searches)
            for t in s.record.trials
            for job in jobs(k, t.params)
        }

    def _outcome(self, measured: list[Measurement]) -> TrialOutcome:
        """Return the stored outcome of a setting; values are None if a joint stuck."""
        base = self.base
        taus = [m.mean / base[m.job.configuration].mean if base else m.mean for m in measured]
        value = float(np.mean(np.abs(taus)))
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


def change(m: Measurement, base: Measurement) -> float:
    """Return the change of |τ| against the base, per cent; negative is less torque."""
    return 100.0 * (abs(m.mean) / abs(base.mean) - 1.0)
