"""The thesis's protocol (4.2) as one function: base torques in, final amplitude table out.

    base torques -> frequencies at scale 1.0 -> best frequency per joint -> scales
      -> intermediate (scale x base of each configuration) -> final (largest of the four)
      -> verification, measured anew with another seed

Every measurement is written to the lab book when it is made: interrupt it anywhere, start it
again, and it goes on.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import (
    Configuration,
    Job,
    Measurement,
    configurations,
)
from stiction_envs.experiments.sje.rows import sje_rows
from stiction_envs.measured import AmplitudeRow, write_amplitudes, write_sje
from tuning.labbook import LabBook
from tuning.rules import Choice, final_amplitude
from tuning.search import Cell, GridStudy, run_grids
from tuning.settings import ThesisSettings

Array = NDArray[np.float64]
Progress = Callable[[str, float, float], None]
TUNE, VERIFY = "tune", "verify"


class ThesisTuner:
    """One run of the protocol in one output folder."""

    def __init__(
        self,
        experiment: SingleJointExperiment,
        out: Path,
        book: LabBook,
        *,
        frequencies: tuple[float, ...],
        scales: tuple[float, ...],
        iterations: int | None,
        storage: str | None,
        study: str,
        progress: Progress | None,
        settings: ThesisSettings,
    ) -> None:
        self.settings = settings
        self.experiment, self.out, self.book = experiment, out, book
        self.frequencies, self.scales = frequencies, scales
        self.iterations = iterations
        self.storage = storage or f"sqlite:///{(out / 'optuna.db').resolve()}"
        self.study, self._progress = study, progress
        self.base: dict[Configuration, Measurement] = {}
        self.cells: dict[Job, Measurement] = {}

    def _measure(self, stage: str, series: str, jobs: list[Job]) -> dict[Job, Measurement]:
        experiment = self.experiment
        if series == VERIFY:
            experiment = experiment.replace(seed=experiment.seed + 1)
        repeats = self.iterations or int(experiment.protocol.iterations)
        missing = [j for j in jobs if self.book.get(series, j) is None]
        rate = experiment.protocol.ramp_rate
        total = sum(experiment.expected(j) / rate + 1.4 for j in missing) * repeats
        done = 0.0

        def report(seconds: float) -> None:
            nonlocal done
            done += seconds
            if self._progress is not None:
                self._progress(stage, min(done, total), total)

        return self.book.measure(
            series, experiment, jobs, iterations=self.iterations, progress=report
        )

    def run_base(self) -> None:
        """Measure the base torques of all configurations."""
        jobs = self.experiment.jobs()
        self.base = {j.configuration: m for j, m in self._measure("base", TUNE, jobs).items()}
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

    def prefetch(self) -> None:
        """Measure every cell of the grid in one batch; the studies then find it in the book.

        Which cells are wanted is known once the bases are, and one batch has one slow tail.
        """
        cs = configurations(self.experiment.n)
        scales = sorted({1.0, *self.scales})
        self._measure(
            "grid", TUNE, [self.job(c, f, s) for c in cs for f in self.frequencies for s in scales]
        )

    def _grids(self, stage: str, scales: tuple[float, ...]) -> list[dict[Cell, float]]:
        n = self.experiment.n
        grid = {"frequency_hz": self.frequencies, "scale": scales}
        studies = [
            GridStudy(
                f"{self.study}-{stage}-joint{j}",
                self.storage,
                grid,
                self.experiment.seed,
                fingerprint=self.book.fingerprint,
            )
            for j in range(1, n + 1)
        ]

        def evaluate(wanted: list[tuple[int, Cell]]) -> dict[tuple[int, Cell], float]:
            jobs = {
                (i, cell): [self.job(c, *cell) for c in configurations(n, [i + 1])]
                for i, cell in wanted
            }
            measured = self._measure(stage, TUNE, [j for group in jobs.values() for j in group])
            return {
                key: float(
                    np.mean(
                        [abs(measured[j].mean / self.base[j.configuration].mean) for j in group]
                    )
                )
                for key, group in jobs.items()
            }

        return run_grids(studies, evaluate)

    def run_frequencies(self) -> list[float]:
        """Try the frequencies at scale 1.0; return the best of each joint [Hz]."""
        values = self._grids("frequency", (1.0,))
        self._collect("frequency.csv", (1.0,))
        best = []
        for v in values:
            real = {cell: value for cell, value in v.items() if cell[0] in self.eligible}
            best.append(min(real, key=lambda c: (real[c], c))[0] if real else self.eligible[-1])
        return best

    @property
    def eligible(self) -> tuple[float, ...]:
        """Frequencies that may be chosen [Hz]: those below half the controller's rate.

        The others alias to a constant offset or to ±A sin φ, whose luck with φ is no dither. They
        are measured all the same, as the thesis did on the iiwa (physics.md 2.6).
        """
        half = self.experiment.interface.controller_rate_hz / 2
        return tuple(f for f in self.frequencies if f < half) or self.frequencies

    def run_scales(self, best: list[float]) -> list[tuple[float, float]]:
        """Try the scales; return (best scale, its mean |τ|/|τ_base|) at each best frequency.

        All frequencies are measured at every scale, as Tables 4.7 and 4.8 show most of them.
        """
        values = self._grids("scale", self.scales)
        self._collect("scale.csv", self.scales)
        out = []
        for v, f in zip(values, best, strict=True):
            mine = {cell[1]: value for cell, value in v.items() if cell[0] == f}
            scale = min(mine, key=lambda s: (mine[s], s)) if mine else 1.0
            out.append((scale, mine.get(scale, np.inf)))
        return out

    def _collect(self, name: str, scales: tuple[float, ...]) -> None:
        jobs = [
            self.job(c, f, s)
            for c in configurations(self.experiment.n)
            for f in self.frequencies
            for s in scales
        ]
        found = {j: m for j in jobs if (m := self.book.get(TUNE, j)) is not None}
        self.cells |= found
        self._write(name, list(found.values()))

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
                settings=self.settings,
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
        """Measure the intermediate and the final amplitudes anew, with another seed."""
        inter, final = [], []
        for choice in choices:
            for c in configurations(self.experiment.n, [choice.joint]):
                _, load, direction = c.index
                a = float(choice.intermediate[load, direction])
                inter.append(Job(c, choice.frequency_hz, a))
                frequency = choice.frequency_hz if choice.amplitude_nm else 0.0
                final.append(Job(c, frequency, choice.amplitude_nm))
        found = self._measure("verification", VERIFY, inter + final)
        out = {
            "intermediate": {j: found[j] for j in inter},
            "final": {j: found[j] for j in final},
        }
        self._write("intermediate.csv", list(out["intermediate"].values()))
        self._write("verification.csv", list(out["final"].values()))
        return out

    def _write(self, name: str, measurements: list[Measurement]) -> None:
        """Write a table of measurements, without those that stuck."""
        rows = sje_rows([*self.base.values(), *measurements], self.experiment.sticking.arm.name)
        wanted = name == "base.csv"
        write_sje(self.out / name, [r for r in rows if r.is_base == wanted])

    def write_final(self, choices: list[Choice]) -> None:
        """Write final.csv."""
        rows = [AmplitudeRow(c.joint, c.frequency_hz, c.amplitude_nm) for c in choices]
        write_amplitudes(self.out / "final.csv", rows)
