"""The thesis's Tables 4.3 and 4.5-4.10, simulated and measured.

    found = reproduce(measure)         # measure(robot, jobs) -> {job: measurement}
    write_tables(folder, found)        # of `tables_page`

The base torques of both robots, the iiwa's first trials, the Panda's frequencies, scales, chosen
amplitudes and their verification. Tables 4.1, 4.2, 4.4 and A.1 are line fits to trajectories and
Table 4.11 is the Generated Trajectory Experiment: not here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import Configuration, Job, Measurement, configurations
from stiction_envs.measured import (
    DitheredRow,
    thesis_base,
    thesis_dithered,
    thesis_robots,
    thesis_table,
)

Array = NDArray[np.float64]
Measured = Mapping[Job, Measurement]
Measure = Callable[[str, list[Job]], Measured]
Rule = Callable[..., tuple[float, str]]
ROBOTS = tuple(thesis_robots())
(TUNED,) = thesis_robots("4.9")
"""The arm whose dither the thesis tuned."""
SCALES = (0.8, 1.0, 1.2)
FREQUENCIES = (80.0, 50.0, 30.0, 15.0)
"""Of Tables 4.6 to 4.8, over the base torque and in Hz."""
TITLES = {
    "4.3": "Base torques, both robots",
    "4.5": "First trials, iiwa",
    "4.6": "Frequencies at scale 1.0, Panda",
    "4.7": "Scale 1.2, Panda",
    "4.8": "Scale 0.8, Panda",
    "4.9": "Chosen settings, Panda",
    "4.10": "Verification: intermediate and final amplitudes, Panda",
}


@dataclass(frozen=True, kw_only=True)
class TableRow:
    """One printed torque and the simulation's; the columns of `tables.csv`."""

    table: str
    """``4.3``, ``4.5`` … ``4.10``."""
    robot: str
    joint: int
    load: str
    direction: str
    amplitude_set: str
    """``base``, ``scale``, ``intermediate`` or ``final``."""
    frequency_hz: float
    """0 without dither."""
    scale: float
    """Amplitude over the base torque [-]; 0 without dither."""
    amplitude_nm: float
    measured_nm: float
    simulated_nm: float
    """Mean over the iterations; NaN if one was stuck."""
    simulated_std_nm: float
    measured_change_pct: float
    """Against the measured base torque [%]; 0 without dither."""
    simulated_change_pct: float
    """Against the simulated base torque [%]."""
    outlier: bool
    """The one printed value that its own repeat refutes."""

    @property
    def configuration(self) -> Configuration:
        """Joint, pose and direction."""
        return Configuration(self.joint, self.load, self.direction)

    @property
    def difference(self) -> float:
        """Simulated less measured, in points of the base torque; in % of it where no dither is."""
        if self.amplitude_nm:
            return self.simulated_change_pct - self.measured_change_pct
        return 100.0 * (self.simulated_nm / self.measured_nm - 1.0)


@dataclass(frozen=True, kw_only=True)
class ChosenRow:
    """A joint's line of Table 4.9, by hand and by the thesis's rules on simulated torques."""

    joint: int
    measured_frequency_hz: float
    measured_scale: float
    measured_final_nm: float
    simulated_frequency_hz: float
    simulated_scale: float
    simulated_final_nm: float
    reason: str


@dataclass(frozen=True, kw_only=True)
class Reproduced:
    """All that was simulated."""

    rows: tuple[TableRow, ...]
    chosen: tuple[ChosenRow, ...]
    """Table 4.9; empty if no rule was given."""
    measured: Mapping[str, Measured]
    """By robot, every measurement, for plots."""


def job_of(row: DitheredRow) -> Job:
    """Return the job that measures a printed cell."""
    c = Configuration(row.joint, row.load, row.direction)
    return Job(c, row.frequency_hz, row.amplitude_nm)


def jobs_of_table(number: str) -> list[tuple[str, Job]]:
    """Return robot and job of all that a table needs, base torques too.

    Args:
        number: of `TITLES`.
    """
    if number == "4.3":
        return [(robot, Job(c)) for robot in ROBOTS for c in configurations(7)]
    if number == "4.9":
        return [(TUNED, j) for j in dict.fromkeys([*map(Job, configurations(7)), *grid().values()])]
    (robot,) = thesis_robots(number)
    jobs = [job_of(r) for r in thesis_dithered(robot) if r.table == number]
    base = [Job(j.configuration) for j in jobs]
    return [(robot, j) for j in dict.fromkeys([*base, *jobs])]


def jobs_of(robot: str) -> list[Job]:
    """Return every job a robot's tables need, base torques first.

    Args:
        robot: ``panda`` or ``iiwa7``.

    Raises:
        StictionError: a robot the thesis has not measured.
    """
    base = [Job(c) for c in configurations(7)]
    dithered = [job_of(r) for r in thesis_dithered(robot)]
    if robot in thesis_robots("4.9"):  # so that the rules of Table 4.9 can choose among all of them
        dithered += grid().values()
    return list(dict.fromkeys([*base, *dithered]))


def grid() -> dict[tuple[Configuration, float, float], Job]:
    """Return the jobs of Tables 4.6 to 4.8, and those left out there, of `TUNED`.

    By configuration, frequency [Hz] and scale.
    """
    first = {
        Configuration(r.joint, r.load, r.direction): abs(r.tau_base_nm)
        for r in thesis_dithered(TUNED)
        if r.table == "4.6"
    }
    return {
        (c, f, s): Job(c, f, s * tau)
        for c, tau in first.items()
        for f in FREQUENCIES
        for s in SCALES
    }


def reproduce(
    measure: Measure, *, rule: Rule | None = None, torque_rate: Array | None = None
) -> Reproduced:
    """Simulate the tables.

    Args:
        measure: measures jobs of a robot.
        rule: ``tuning.rules.final_amplitude``; None leaves Table 4.9 out.
        torque_rate: (7,) limit of the Panda's torque rate [N·m/s], for that rule.

    Returns:
        Rows in the order of the thesis.
    """
    measured = {robot: measure(robot, jobs_of(robot)) for robot in ROBOTS}
    numbers = [number for number in TITLES if number != "4.9"]
    return Reproduced(
        rows=tuple(r for number in numbers for r in rows_of_table(number, measured)),
        chosen=() if rule is None else choices(measured[TUNED], rule, torque_rate),
        measured=measured,
    )


def rows_of_table(number: str, measured: Mapping[str, Measured]) -> list[TableRow]:
    """Return the rows of a table, in its order.

    Args:
        number: of `TITLES`, but 4.9.
        measured: by robot, at least `jobs_of_table`.
    """
    if number == "4.3":
        return [
            _row(number, robot, measured[robot], job, None) for robot, job in jobs_of_table("4.3")
        ]
    (robot,) = thesis_robots(number)
    printed = [r for r in thesis_dithered(robot) if r.table == number]
    return [_row(number, robot, measured[robot], job_of(r), r) for r in printed]


def choices(
    measured: Measured, rule: Rule, torque_rate: Array | None = None
) -> tuple[ChosenRow, ...]:
    """Return Table 4.9 by the thesis's rules on simulated torques.

    Args:
        measured: of `TUNED`, at least its base torques and `grid`.
        rule: ``tuning.rules.final_amplitude``.
        torque_rate: (7,) limit of the torque rate [N·m/s]; None for none.
    """
    rate = np.full(7, np.inf) if torque_rate is None else torque_rate
    return tuple(_choose(j, measured, rule, float(rate[j - 1])) for j in range(1, 8))


def _row(
    table: str, robot: str, measured: Measured, job: Job, printed: DitheredRow | None
) -> TableRow:
    c, m = job.configuration, measured[job]
    base = measured[Job(c)]
    return TableRow(
        table=table,
        robot=robot,
        joint=c.joint,
        load=c.load,
        direction=c.direction,
        amplitude_set="base" if printed is None else printed.amplitude_set,
        frequency_hz=job.frequency_hz,
        scale=0.0 if printed is None else printed.scale,
        amplitude_nm=job.amplitude_nm,
        measured_nm=thesis_base(robot).get(c.joint, c.load, c.direction)
        if printed is None
        else printed.tau_sje_nm,
        simulated_nm=m.mean,
        simulated_std_nm=m.std if len(m.tau) > 1 else math.nan,
        measured_change_pct=0.0 if printed is None else printed.change_pct,
        simulated_change_pct=0.0 if printed is None else _change(m, base),
        outlier=printed is not None and printed.outlier,
    )


def _change(m: Measurement, base: Measurement) -> float:
    return 100.0 * (abs(m.mean) / abs(base.mean) - 1.0)


def _choose(joint: int, measured: Measured, rule: Rule, torque_rate: float) -> ChosenRow:
    """Apply the thesis's choices (4.2) to one joint's simulated torques."""
    own = {key: job for key, job in grid().items() if key[0].joint == joint}

    def mean(frequency: float, scale: float) -> float:
        mine = [job for (_, f, s), job in own.items() if (f, s) == (frequency, scale)]
        return float(np.mean([_change(measured[j], measured[Job(j.configuration)]) for j in mine]))

    frequency = min(FREQUENCIES, key=lambda f: mean(f, 1.0))
    scale = min(SCALES, key=lambda s: mean(frequency, s))
    base = thesis_base(TUNED)
    amplitude, reason = rule(
        scale * np.abs(base.tau[joint - 1]),
        float(base.friction[joint - 1].min()),
        frequency_hz=frequency,
        torque_rate=torque_rate,
    )
    printed = next(r for r in thesis_table("4.9") if r["joint"] == joint)
    return ChosenRow(
        joint=joint,
        measured_frequency_hz=printed["frequency_Hz"],
        measured_scale=printed["scale"],
        measured_final_nm=abs(printed["tau_final_Nm"]),
        simulated_frequency_hz=frequency,
        simulated_scale=scale,
        simulated_final_nm=amplitude,
        reason=reason,
    )


def scores(rows: Iterable[TableRow]) -> dict[str, dict[str, float]]:
    """Return by table: cells, mean, median and largest |difference| [% of base], outliers apart."""
    out: dict[str, dict[str, float]] = {}
    for number in TITLES:
        gaps = [abs(r.difference) for r in rows if r.table == number and not r.outlier]
        good = [g for g in gaps if math.isfinite(g)]
        if good:
            out[number] = {
                "cells": len(gaps),
                "mean": float(np.mean(good)),
                "median": float(np.median(good)),
                "largest": float(np.max(good)),
            }
    return out
