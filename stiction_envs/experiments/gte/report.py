"""A Generated Trajectory Experiment for people: ``report.md`` and ``report.html``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stiction_envs.experiments.gte.rows import ErrorRow, RunRow
from stiction_envs.reporting.markdown import number, percent, plural, short, table_text
from stiction_envs.reporting.templates import write_md_and_html
from stiction_envs.robots.registry import arm_title

TEMPLATE = Path(__file__).parent / "templates" / "report.md.j2"
WORDS = {
    "no_dither": "no dither",
    "dither": "dither",
    "feedforward": "feedforward of friction",
    "feedforward_dither": "feedforward of friction with dither",
    "push": "push against the error",
    "push_dither": "push against the error with dither",
}
"""Cases of `stiction_envs.experiments.gte.rows.CASES` as a sentence names them."""
MILLI = 1e3


def write_report(
    folder: Path,
    rows: Sequence[ErrorRow],
    runs: Sequence[RunRow],
    *,
    printed: bool,
    note: str = "",
) -> None:
    """Write both pages.

    Args:
        folder: an existing one, with the pictures.
        rows: of ``errors.csv``, six axes per case, the case without anything first.
        runs: of ``runs.csv``, a row per case.
        printed: whether the folder has a picture of Table 4.11.
        note: stands at the top.
    """
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
                "words": WORDS[run.case],
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
        printed=printed,
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
            (run.unfinished, "{} never reached the last goal"),
            (run.singular, "{} came near a singular pose"),
            (run.near_limit, "{} came near a joint's limit"),
        ):
            if count:
                words = f"{WORDS[run.case]}: {what.format(plural(count, 'iteration'))}"
                found.append(f"{words} of {run.iterations}")
    return "; ".join(found)


def _errors(cases: dict[str, list[ErrorRow]], column: str, factor: float) -> str:
    """Return a table of one error, an axis in a line; what is not the first case with its change.

    Args:
        cases: six axes each.
        column: of `ErrorRow`.
        factor: of the unit that is shown to the row's.
    """
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
    return table_text(["axis", *(WORDS[name] for name in cases)], rows)


def _runs(runs: Sequence[RunRow]) -> str:
    header = ["case", "duration [s]", "vibration [mm]", "at rest [mm]", "dither energy [J]"]
    return table_text(
        [*header, "torque rate up to [N·m/s]", "goals missed"],
        [
            [
                WORDS[run.case],
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
