"""Tracking errors of a Generated Trajectory Experiment: tables, plots, a line per axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import Run
from stiction_envs.experiments.gte.rows import (
    ErrorRow,
    RunRow,
    error_rows,
    run_row,
    thesis_window_sums,
    write_points,
    write_rows,
    write_trace,
)
from stiction_envs.reporting.result import Result


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrackingErrors(Result):
    """What an arm did on its paths."""

    robot: str
    runs: tuple[tuple[Run, Measures], ...]
    """One per case."""
    compared: bool
    """Whether the thesis's numbers of the same cases, where it has them, are shown too."""
    provenance: dict[str, Any]
    note: str = ""
    """Stands at the top of the report."""

    @property
    def rows(self) -> list[ErrorRow]:
        """Rows of ``errors.csv``: an axis of a case each."""
        return [row for r, m in self.runs for row in error_rows(r, m, self.robot)]

    @property
    def run_rows(self) -> list[RunRow]:
        """Rows of ``runs.csv``: a case each."""
        return [run_row(r, m, self.robot) for r, m in self.runs]

    @property
    def unfinished(self) -> int:
        """Iterations that never reached their last goal."""
        return sum(row.unfinished for row in self.run_rows)

    def to_json(self) -> dict[str, Any]:
        """Return robot, rows with the thesis's number where it has one, and runs."""
        rows = []
        for r, m in self.runs:
            printed = (thesis_window_sums(r.case) if self.compared else None) or {}
            for row in error_rows(r, m, self.robot):
                rows.append({**asdict(row), "thesis_window_sum": printed.get(row.axis)})
        return {
            "robot": self.robot,
            "rows": rows,
            "runs": [asdict(row) for row in self.run_rows],
        }

    def write(self, folder: Path) -> None:
        """Write ``errors.csv``, ``runs.csv``, ``points.csv``, ``trace.csv``, plots and report.

        Args:
            folder: an existing one.
        """
        from stiction_envs.experiments.gte import plots
        from stiction_envs.experiments.gte.report import write_report

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
        printed = [self.compared and thesis_window_sums(run.case) for run in runs[:2]]
        in_thesis = len(printed) == 2 and all(printed)
        if in_thesis:
            pair = [(self.runs[0], self.runs[1])]
            plots.plot_window_sums(pair, folder / "table_4_11.png", robot=self.robot)
        write_report(folder, self.rows, self.run_rows, printed=in_thesis, note=self.note)

    def __repr__(self) -> str:
        return f"<TrackingErrors of {self.robot}: {len(self.runs)} cases>"

    def __str__(self) -> str:
        answer = self.to_json()
        return describe(answer["rows"], answer["runs"])


def describe(rows: Sequence[Mapping[str, Any]], runs: Sequence[Mapping[str, Any]]) -> str:
    """Return errors as text: an axis in a line, then a line per case.

    Args:
        rows: of ``errors.csv`` with ``thesis_window_sum``, by column.
        runs: of ``runs.csv``.
    """
    by_case: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        by_case.setdefault(row["case"], []).append(row)
    base, *others = by_case.values()
    printed = [name for name, row in by_case.items() if row[0]["thesis_window_sum"] is not None]
    head = f"{'sum of |error|':<20}{_words(base[0]):>18}"
    head += "".join(f"{_words(other[0]):>20}{'change':>9}" for other in others)
    head += "".join(f"{_THESIS.get(name, name):>18}" for name in printed)
    lines = [head]
    for k, row in enumerate(base):
        line = f"{row['axis'] + ' [' + row['unit'] + '·samples]':<20}{_sum(row):>18}"
        for other in others:
            change = 100 * (other[k]["window_sum"] / row["window_sum"] - 1)
            line += f"{_sum(other[k]):>20}{change:>+7.1f} %"
        line += "".join(f"{by_case[name][k]['thesis_window_sum']:>18.3f}" for name in printed)
        lines.append(line)
    return "\n".join([*lines, *(_run_text(r) for r in runs)])


_THESIS = {"no_dither": "thesis: without", "dither": "thesis: with"}


def _words(row: Mapping[str, Any]) -> str:
    return str(row["case"]).replace("_", " ")


def _run_text(r: Mapping[str, Any]) -> str:
    text = f"{_words(r)}: {r['duration_s']:.2f} s, "
    text += f"vibration {1e3 * r['vibration_m']:.3f} mm "
    text += f"({1e3 * r['vibration_at_rest_m']:.3f} mm at rest), "
    text += f"dither energy {r['dither_energy_j']:.2f} J, "
    text += f"torque rate up to {r['peak_torque_rate_nm_s']:.0f} N·m/s"
    if r["goals_missed"]:
        text += f", {r['goals_missed']} goals left beyond the tolerance"
    if r["singular"] or r["near_limit"]:
        text += f", iterations singular {r['singular']}, near a limit {r['near_limit']}"
    return text


def _sum(row: Mapping[str, Any]) -> str:
    spread = "" if row["iterations"] == 1 else f" ± {row['window_sum_std']:.3f}"
    return f"{row['window_sum']:.3f}{spread}"
