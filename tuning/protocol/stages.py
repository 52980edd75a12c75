"""The thesis's protocol (4.2) as one function: base torques in, final amplitude table out.

    base torques -> frequencies at scale 1.0 -> best frequency per joint -> scales
      -> intermediate (scale x base of each configuration) -> final (largest of the four)
      -> verification, measured again with another seed

Every measurement is kept in an Optuna study, the only record: one study of the base torques, one
per joint of the grid, one of the verification. A trial is a setting of a joint; its value is the
mean of |τ|/|τ_base| (of |τ| [N·m] in the first) over the joint's four configurations; its user
attributes are the measurements. An interrupted run continues when it is started again; on a
database, several machines can share it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from optuna.distributions import CategoricalDistribution

from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import (
    Configuration,
    Job,
    Measurement,
    configurations,
)
from stiction_envs.experiments.sje.results import sje_rows
from stiction_envs.measured import AmplitudeRow, write_final, write_sje
from tuning.protocol.measurements import as_data, from_data
from tuning.protocol.rules import Choice, final_amplitude
from tuning.settings import SharedSettings, TuningSettings
from tuning.study.record import Outcome, Parameters, Record, Search
from tuning.study.samplers import sampler
from tuning.study.workers import fill

Array = NDArray[np.float64]
Progress = Callable[[str, float, float], None]
Cell = tuple[float, float]
"""Frequency [Hz] and scale [-]."""
Jobs = Callable[[int, Parameters], list[Job]]
"""Jobs of a setting of a search (given by number), one per configuration of its joint."""


@dataclass(kw_only=True, eq=False)
class ThesisTuner:
    """One run of the protocol in an output folder."""

    experiment: SingleJointExperiment
    out: Path
    about: Mapping[str, Any]
    """Definition of the run."""
    frequencies: tuple[float, ...]
    """Frequencies to try [Hz]."""
    scales: tuple[float, ...]
    """Amplitude over base torque [-]."""
    iterations: int | None
    storage: str | None
    """URL or file; None for a SQLite file in ``out``."""
    study: str
    """Prefix of the studies' names."""
    progress: Progress | None
    settings: TuningSettings
    base: dict[Configuration, Measurement] = field(default_factory=dict)
    cells: dict[Job, Measurement] = field(default_factory=dict)
    _ratios: list[dict[Cell, float]] = field(default_factory=list)

    def _search(self, name: str, space: dict[str, CategoricalDistribution], batch: int) -> Search:
        """Return the search of a whole grid; each cell occurs once, in an order from the seed."""
        storage = self.storage or f"sqlite:///{(self.out / 'optuna.db').resolve()}"
        return Search(
            record=study_of(name, storage, self.study, self.about, self.settings.shared),
            space=space,
            sampler=sampler("grid", space, seed=self.experiment.seed, startup=0),
            evaluations=int(np.prod([len(d.choices) for d in space.values()])),
            batch=batch,
        )

    def _measure(
        self, stage: str, searches: Sequence[Search], jobs: Jobs, experiment: SingleJointExperiment
    ) -> dict[Job, Measurement]:
        """Fill the studies of a stage; return the measurements of all their trials."""
        n = sum(s.evaluations for s in searches)
        seconds = done = 0.0

        def report(more: float) -> None:
            nonlocal done
            done += more
            if self.progress is not None:
                self.progress(stage, min(done, seconds), seconds)

        def evaluate(wanted: list[tuple[int, Parameters]]) -> list[Outcome]:
            nonlocal seconds
            groups = [jobs(k, setting) for k, setting in wanted]
            distinct = list(dict.fromkeys(j for group in groups for j in group))
            if not seconds:  # of the remaining settings, judged by these
                left = n - sum(len(s.record.trials) for s in searches)
                part = experiment.expected_seconds(distinct, self.iterations)
                seconds = part * left / len(wanted)
            run = experiment.run(distinct, iterations=self.iterations, progress=report)
            measured = {m.job: m for m in run}
            return [self._outcome([measured[j] for j in group]) for group in groups]

        fill(searches, evaluate)
        return {
            job: from_data(job, t.user_attrs[_key(job.configuration)])
            for k, s in enumerate(searches)
            for t in s.record.trials
            for job in jobs(k, t.params)
        }

    def _outcome(self, measured: list[Measurement]) -> Outcome:
        """Return what is stored of a setting; None as values where a joint stuck."""
        base = self.base
        torques = [
            abs(m.mean / base[m.job.configuration].mean if base else m.mean) for m in measured
        ]
        value = float(np.mean(torques))
        return Outcome(
            values=(value,) if np.isfinite(value) else None,
            measures={_key(m.job.configuration): as_data(m) for m in measured},
        )

    def run_base(self) -> None:
        """Measure the base torques of all configurations."""
        n = self.experiment.n
        joints = {"joint": CategoricalDistribution(range(1, n + 1))}

        def jobs(_: int, setting: Parameters) -> list[Job]:
            return [Job(c) for c in configurations(n, [setting["joint"]])]

        found = self._measure("base", [self._search("base", joints, n)], jobs, self.experiment)
        self.base = {j.configuration: found[j] for j in self.experiment.jobs()}
        stuck = [c for c, m in self.base.items() if not np.isfinite(m.mean)]
        if stuck:
            c = stuck[0]
            raise ExperimentError(
                f"joint {c.joint}, {c.load}, {c.direction}: stuck without dither at "
                f"{self.experiment.protocol.give_up_factor:g} times its stiction"
            )
        self._write("base.csv", [])

    def job(self, c: Configuration, frequency: float, scale: float) -> Job:
        """Return the job of a configuration at a frequency [Hz], A = scale × |base|."""
        return Job(c, frequency, scale * abs(self.base[c].mean))

    def run_grid(self) -> None:
        """Measure every cell of all joints together: frequencies at every scale, and at 1.0.

        All frequencies are measured at every scale, as Tables 4.7 and 4.8 show most of them.
        """
        n = self.experiment.n
        cells = {
            "frequency_hz": CategoricalDistribution(self.frequencies),
            "scale": CategoricalDistribution(sorted({1.0, *self.scales})),
        }
        joints = range(1, n + 1)
        searches = [self._search(f"joint{j}", cells, self.settings.thesis.batch) for j in joints]

        def jobs(k: int, cell: Parameters) -> list[Job]:
            return [
                self.job(c, cell["frequency_hz"], cell["scale"]) for c in configurations(n, [k + 1])
            ]

        self.cells = self._measure("grid", searches, jobs, self.experiment)
        self._ratios = [
            {
                (t.params["frequency_hz"], t.params["scale"]): t.values[0]
                for t in s.record.trials
                if t.values is not None
            }
            for s in searches
        ]

    def run_frequencies(self) -> list[float]:
        """Compare the frequencies at scale 1.0; return the best of each joint [Hz]."""
        self._write_cells("frequency.csv", (1.0,))
        best = []
        for ratios in self._ratios:
            real = {f: v for (f, x), v in ratios.items() if x == 1.0 and f in self.eligible}
            best.append(min(real, key=lambda f: (real[f], f)) if real else self.eligible[-1])
        return best

    @property
    def eligible(self) -> tuple[float, ...]:
        """Frequencies that may be chosen [Hz]: those below half the controller's rate.

        The others alias to a constant offset or to ±A sin φ, whose effect depends on φ by chance:
        that is not dither. They are still measured, as the thesis did on the iiwa (sources.md 2.6).
        """
        half = self.experiment.interface.controller_rate_hz / 2
        return tuple(f for f in self.frequencies if f < half) or self.frequencies

    def run_scales(self, best: list[float]) -> list[tuple[float, float]]:
        """Compare the scales; return (best scale, its mean |τ|/|τ_base|) at each best frequency."""
        self._write_cells("scale.csv", self.scales)
        out = []
        for ratios, f in zip(self._ratios, best, strict=True):
            mine = {x: v for (g, x), v in ratios.items() if g == f and x in self.scales}
            scale = min(mine, key=lambda x: (mine[x], x)) if mine else 1.0
            out.append((scale, mine.get(scale, np.inf)))
        return out

    def _write_cells(self, name: str, scales: tuple[float, ...]) -> None:
        jobs = [
            self.job(c, f, s)
            for c in configurations(self.experiment.n)
            for f in self.frequencies
            for s in scales
        ]
        self._write(name, [self.cells[j] for j in dict.fromkeys(jobs)])

    def choose(self, best: list[float], scales: list[tuple[float, float]]) -> list[Choice]:
        """Return the final choice of every joint."""
        choices = []
        rates = self.experiment.interface.torque_rate
        for i, (f, (scale, ratio)) in enumerate(zip(best, scales, strict=True)):
            tau = np.array(
                [
                    [self.base[Configuration(i + 1, load, d)].mean for d in "+-"]
                    for load in ("load", "no_load")
                ]
            )
            half = float(((tau[:, 0] - tau[:, 1]) / 2).min())
            inter = scale * np.abs(tau)
            amplitude, reason = final_amplitude(
                inter,
                half,
                frequency_hz=f,
                torque_rate=float(rates[i]),
                settings=self.settings.thesis,
            )
            if ratio >= 1.0:
                amplitude, reason = 0.0, "no dither lowered the torque"
            choices.append(
                Choice(
                    joint=i + 1,
                    frequency_hz=f,
                    scale=scale,
                    intermediate=inter,
                    half_width=half,
                    amplitude_nm=amplitude,
                    reason=reason,
                )
            )
        return choices

    def verify(self, choices: list[Choice]) -> dict[str, dict[Job, Measurement]]:
        """Measure the intermediate and the final amplitudes again, with another seed."""
        n = self.experiment.n

        def jobs(_: int, setting: Parameters) -> list[Job]:
            choice = choices[setting["joint"] - 1]
            final = choice.frequency_hz if choice.amplitude_nm else 0.0
            out = []
            for c in configurations(n, [choice.joint]):
                _, load, direction = c.index
                a = float(choice.intermediate[load, direction])
                inter = setting["table"] == "intermediate"
                out.append(
                    Job(c, choice.frequency_hz, a) if inter else Job(c, final, choice.amplitude_nm)
                )
            return out

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
                job: found[job]
                for choice in choices
                for job in jobs(0, {"joint": choice.joint, "table": table})
            }
            for table in tables
        }
        self._write("intermediate.csv", list(out["intermediate"].values()))
        self._write("verification.csv", list(out["final"].values()))
        return out

    def _write(self, name: str, measurements: list[Measurement]) -> None:
        """Write a table of measurements, without those of joints that stuck."""
        rows = sje_rows([*self.base.values(), *measurements], self.experiment.sticking.arm.name)
        wanted = name == "base.csv"
        write_sje(self.out / name, [r for r in rows if r.is_base == wanted])

    def write_final(self, choices: list[Choice]) -> None:
        """Write final.csv and final.yaml."""
        rows = [AmplitudeRow(c.joint, c.frequency_hz, c.amplitude_nm) for c in choices]
        write_final(self.out, rows, self.experiment.sticking.arm.joint_names)


def study_of(
    stage: str, storage: str, study: str, about: Mapping[str, Any], settings: SharedSettings
) -> Record:
    """Open the study of a stage: base, joint1 to jointn, or verification.

    Raises:
        StictionError: a storage that cannot be opened, or a study of another run.
    """
    about = {**about, "stage": stage}
    return Record(storage, f"{study}-{stage}", about=about, settings=settings)


def _key(c: Configuration) -> str:
    """Return the name of the user attribute of a trial with a configuration's results."""
    return f"{c.load}{c.direction}"
