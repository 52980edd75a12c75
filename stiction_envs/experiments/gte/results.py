"""Tracking errors of a Generated Trajectory Experiment: tables, plots, a line per axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stiction_envs.control.laws import LAWS
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import Run
from stiction_envs.experiments.gte.rows import (
    ErrorRow,
    RunRow,
    error_rows,
    run_row,
    write_points,
    write_rows,
    write_trace,
)
from stiction_envs.reporting.markdown import aligned, number, percent, plural, short, table_text
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.reporting.result import Result
from stiction_envs.robots.registry import arm_title


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrackingErrors(Result):
    """Tracking errors of an arm on its paths."""

    robot: str
    runs: tuple[tuple[Run, Measures], ...]  # One per case
    provenance: Provenance
    note: str = ""  # Stands at the top of the report

    @property
    def rows(self) -> list[ErrorRow]:
        """Rows of ``errors.csv``: an axis of a case each."""
        return [row for r, m in self.runs for row in error_rows(r, m, self.robot)]

    @property
    def run_rows(self) -> list[RunRow]:
        """Rows of ``runs.csv``: a case each."""
        return [run_row(r, m, self.robot) for r, m in self.runs]

    def to_json(self) -> dict[str, Any]:
        """Return robot, rows and runs."""
        return {
            "robot": self.robot,
            "rows": [asdict(row) for row in self.rows],
            "runs": [asdict(row) for row in self.run_rows],
        }

    def write(self, folder: Path) -> None:
        """Write ``errors.csv``, ``runs.csv``, ``points.csv``, ``trace.csv``, plots and report."""
        from stiction_envs.experiments.gte import plots

        runs = [r for r, _ in self.runs]
        write_rows(folder / "errors.csv", self.rows)
        write_rows(folder / "runs.csv", self.run_rows)
        write_points(folder / "points.csv", self.runs)
        write_trace(folder / "trace.csv", runs)
        plots.plot_path_xy(runs, folder / "path_xy.png", robot=self.robot)
        plots.plot_path_3d(runs, folder / "path_3d.png", robot=self.robot)
        plots.plot_errors(runs, folder / "error_position.png", robot=self.robot)
        plots.plot_errors(
            runs, folder / "error_orientation.png", robot=self.robot, orientation=True
        )
        write_report(folder, self.rows, self.run_rows, note=self.note)

    def __repr__(self) -> str:
        return f"<TrackingErrors of {self.robot}: {len(self.runs)} cases>"

    def __str__(self) -> str:
        rows = self.rows
        cases = [[r for r in rows if r.case == run.case] for run in self.run_rows]
        base, *others = cases
        header = ["sum of |error|", _words(base[0].case)]
        header += [x for other in others for x in (_words(other[0].case), "change")]
        lines = []
        for k, row in enumerate(base):
            line = [f"{row.axis} [{row.unit}·samples]", _sum(row)]
            line += [x for other in others for x in (_sum(other[k]), _change(row, other[k]))]
            lines.append(line)
        return "\n".join([aligned(header, lines), *map(_run_text, self.run_rows)])


def _words(case: str) -> str:
    """Return a case as a sentence names it."""
    kind = case.removesuffix("_dither")
    if kind in LAWS:
        return LAWS[kind].words + (" with dither" if kind != case else "")
    return case.replace("_", " ")


def _change(row: ErrorRow, other: ErrorRow) -> str:
    """Return by how much an error differs; an arm may not move along an axis at all."""
    return percent(100 * (other.window_sum / row.window_sum - 1)) if row.window_sum else "–"


def _run_text(r: RunRow) -> str:
    text = f"{_words(r.case)}: {r.duration_s:.2f} s, "
    text += f"vibration {1e3 * r.vibration_m:.3f} mm "
    text += f"({1e3 * r.vibration_at_rest_m:.3f} mm at rest), "
    text += f"dither energy {r.dither_energy_j:.2f} J, "
    text += f"torque rate up to {r.peak_torque_rate_nm_s:.0f} N·m/s"
    if r.goals_missed:
        text += f", {r.goals_missed} goals left beyond the tolerance"
    if r.singular or r.near_limit:
        text += f", iterations singular {r.singular}, near a limit {r.near_limit}"
    return text


def _sum(row: ErrorRow) -> str:
    spread = "" if row.iterations == 1 else f" ± {row.window_sum_std:.3f}"
    return f"{row.window_sum:.3f}{spread}"


TEMPLATE = Path(__file__).parent / "templates" / "report.md.j2"
MILLI = 1e3


def write_report(
    folder: Path, rows: Sequence[ErrorRow], runs: Sequence[RunRow], *, note: str = ""
) -> None:
    """Write both pages; cases are compared with the first, without dither and compensation."""
    from stiction_envs.reporting.templates import write_md_and_html

    cases = {run.case: [r for r in rows if r.case == run.case] for run in runs}
    first = runs[0]
    base = _left(cases[first.case])
    name = arm_title(first.robot)
    path = first.trajectory
    path = f"the {path}" if path in ("triangle", "pentagon") else path
    write_md_and_html(
        folder,
        TEMPLATE,
        f"{name} on {path}",
        note=note,
        robot=name,
        path=path,
        base={"position": MILLI * base[0], "orientation": MILLI * base[1]},
        changes=[
            {
                "words": _words(run.case),
                "position": _share(_left(cases[run.case])[0], base[0]),
                "orientation": _share(_left(cases[run.case])[1], base[1]),
                "motion": _share(_moving(cases[run.case]), _moving(cases[first.case])),
                "vibration": MILLI * run.vibration_m,
                "at_rest": MILLI * run.vibration_at_rest_m,
            }
            for run in runs[1:]
        ],
        trouble=_trouble(runs),
        stiffness=f"{first.stiffness_translation:g} N/m, {first.stiffness_rotation:g} N·m/rad, "
        f"nullspace {first.stiffness_nullspace:g} N·m/rad",
        iterations=first.iterations,
        left=_errors(cases, "settling", MILLI),
        window=_errors(cases, "window_sum", 1.0),
        runs=_runs(runs),
    )


def _left(rows: Sequence[ErrorRow]) -> tuple[float, float]:
    """Return position [m] and orientation [rad] error left at the last goal, over three axes."""
    left = np.array([row.settling for row in rows])
    return float(np.linalg.norm(left[:3])), float(np.linalg.norm(left[3:]))


def _moving(rows: Sequence[ErrorRow]) -> float:
    return float(np.linalg.norm([row.mean for row in rows[:3]]))


def _share(value: float, of: float) -> float:
    return 100 * value / of if of else math.nan


def _trouble(runs: Sequence[RunRow]) -> str:
    found = []
    for run in runs:
        for count, what in (
            (run.singular, "{} came near a singular pose"),
            (run.near_limit, "{} came near a joint's limit"),
        ):
            if count:
                words = f"{_words(run.case)}: {what.format(plural(count, 'iteration'))}"
                found.append(f"{words} of {run.iterations}")
    return "; ".join(found)


def _errors(cases: dict[str, list[ErrorRow]], column: str, factor: float) -> str:
    """Return a table of one error, an axis in a line; other cases with their change."""
    base, *others = cases.values()
    milli = "m" if factor == MILLI else ""
    rows = []
    for k, axis in enumerate(base):
        before = getattr(axis, column)
        line = [f"{axis.axis} [{milli}{axis.unit}]", short(factor * before)]
        for case in others:
            value = getattr(case[k], column)
            line.append(f"{short(factor * value)} ({percent(_share(value, before) - 100, 0)})")
        rows.append(line)
    return table_text(["axis", *(_words(name) for name in cases)], rows)


def _runs(runs: Sequence[RunRow]) -> str:
    header = ["case", "duration [s]", "vibration [mm]", "at rest [mm]", "dither energy [J]"]
    return table_text(
        [*header, "torque rate up to [N·m/s]", "goals missed"],
        [
            [
                _words(run.case),
                number(run.duration_s, 2),
                number(MILLI * run.vibration_m, 3),
                number(MILLI * run.vibration_at_rest_m, 3),
                number(run.dither_energy_j, 2),
                number(run.peak_torque_rate_nm_s, 0),
                str(run.goals_missed),
            ]
            for run in runs
        ],
    )
