"""Tracking errors of a Generated Trajectory Experiment: tables, plots, a line per axis."""

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
    write_trace,
)
from stiction_envs.measured.csv_text import write_rows
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

        runs, tables = [r for r, _ in self.runs], self.to_json()
        write_rows(folder / "errors.csv", tables["rows"])
        write_rows(folder / "runs.csv", tables["runs"])
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
        runs = self.run_rows
        sums = _errors(_by_case(self.rows), "window_sum", 1.0)
        title = "sum of |error| over the samples of the window\n"
        texts = [title + aligned(*sums), aligned(*_runs(runs)), _trouble(runs)]
        return "\n\n".join(filter(None, texts))


def _words(case: str) -> str:
    """Return a case as a sentence names it."""
    kind = case.removesuffix("_dither")
    if kind in LAWS:
        return LAWS[kind].words + (" with dither" if kind != case else "")
    return case.replace("_", " ")


TEMPLATE = Path(__file__).parent / "templates" / "report.md.j2"
MILLI = 1e3
Cells = tuple[list[str], list[list[str]]]  # Header and lines of a table


def write_report(
    folder: Path, rows: Sequence[ErrorRow], runs: Sequence[RunRow], *, note: str = ""
) -> None:
    """Write both pages; cases are compared with the first, without dither and compensation."""
    from stiction_envs.reporting.templates import write_md_and_html

    cases = _by_case(rows)
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
        left=table_text(*_errors(cases, "settling", MILLI)),
        window=table_text(*_errors(cases, "window_sum", 1.0)),
        runs=table_text(*_runs(runs)),
    )


def _by_case(rows: Sequence[ErrorRow]) -> dict[str, list[ErrorRow]]:
    cases: dict[str, list[ErrorRow]] = {}
    for row in rows:
        cases.setdefault(row.case, []).append(row)
    return cases


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
        for count, place in (
            (run.singular, "a singular pose"),
            (run.near_limit, "a joint's limit"),
        ):
            if count:
                words = f"{_words(run.case)}: {plural(count, 'iteration')}"
                found.append(f"{words} came near {place} of {run.iterations}")
    return "; ".join(found)


def _errors(cases: dict[str, list[ErrorRow]], column: str, factor: float) -> Cells:
    """Return header and cells of one error, an axis in a line; other cases with their change."""
    milli = "m" if factor == MILLI else ""
    rows = []
    for axes in zip(*cases.values(), strict=True):
        before = getattr(axes[0], column)
        line = [f"{axes[0].axis} [{milli}{axes[0].unit}]"]
        for k, row in enumerate(axes):
            value, spread = getattr(row, column), getattr(row, f"{column}_std", math.nan)
            text = short(factor * value)
            if math.isfinite(spread):
                text += f" ± {number(factor * spread, len(text.partition('.')[2]))}"
            text += f" ({percent(_share(value, before) - 100, 0)})" * (k > 0)
            line.append(text)
        rows.append(line)
    return ["axis", *(_words(name) for name in cases)], rows


def _runs(runs: Sequence[RunRow]) -> Cells:
    header = ["case", "duration [s]", "vibration [mm]", "at rest [mm]", "dither energy [J]"]
    return (
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
