"""Runs of the Generated Trajectory Experiment as table rows; the thesis's settings."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction_envs.experiments.gte.measures import Measures, error_against_time
from stiction_envs.experiments.gte.protocol import AXES, FLAGS, Case, Run
from stiction_envs.measured.csv_text import write_lines
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.measured.thesis_tables import thesis_table

UNITS = dict(zip(AXES, 3 * ["m"] + 3 * ["rad"], strict=True))  # Of the errors of each axis
_AXES = tuple(f"{axis}_{unit}" for axis, unit in UNITS.items())
POINT_COLUMNS = ("case", "goal", "accepted_s", "reached_s", *_AXES)
"""Columns of ``points.csv``: goals from 1, mean times, then the mean absolute settling error."""
TRACE_COLUMNS = ("case", "time_s", *_AXES, *(f"std_{axis}" for axis in _AXES))
"""Columns of ``trace.csv``: mean error and its standard deviation over iterations."""


@dataclass(frozen=True)
class CaseRow:
    """Columns that name a case."""

    robot: str
    trajectory: str
    stiffness_translation: float  # [N/m]
    stiffness_rotation: float  # [N·m/rad]
    stiffness_nullspace: float  # [N·m/rad]
    case: str  # See `case_name`


@dataclass(frozen=True)
class ErrorRow(CaseRow):
    """One axis of one case, means over iterations."""

    axis: str
    unit: str  # ``m`` or ``rad``, of all errors; window sums are in unit times samples
    window_sum: float  # Sum of the absolute error over the window, as in Table 4.11
    window_sum_std: float  # Standard deviation of the window sum over iterations; NaN for one
    mean: float  # Mean absolute error over the motion
    rms: float  # Root mean square over the motion: of each iteration, then their mean
    max: float  # Largest absolute error of any iteration
    corner: float  # Mean absolute error when a new goal was accepted; NaN for a path of one goal
    settling: float  # Mean absolute error left at the last goal, after the protocol's tail
    iterations: int


@dataclass(frozen=True)
class RunRow(CaseRow):
    """Results of one case over the whole path, means over iterations."""

    duration_s: float  # When the last goal was reached
    vibration_m: float
    """Root mean square above the protocol's `vibration_low`: of the position, and of turns times
    the protocol's `vibration_lever`."""
    vibration_at_rest_m: float  # The same after the last goal was reached
    dither_energy_j: float
    peak_torque_rate_nm_s: float  # The largest of all iterations and joints
    singular: int  # Iterations in which the controller raised this flag; the next two likewise
    saturated: int
    near_limit: int
    goals_missed: int  # Goals of all iterations that the arm left beyond the tolerance
    iterations: int


def case_name(case: Case) -> str:
    """Return the name of a case: no_dither, dither, push, push_dither and so on."""
    if case.compensation is None:
        return "dither" if case.dithered else "no_dither"
    return case.compensation.kind + ("_dither" if case.dithered else "")


def error_rows(run: Run, measures: Measures, robot: str) -> list[ErrorRow]:
    """Return the row of each axis."""
    m, count = measures, len(run.accepted)
    spread = m.window_sum.std(axis=0, ddof=1) if count > 1 else np.full(6, np.nan)
    # a path of one goal has no corner
    corner = np.abs(m.corner).mean(axis=(0, 1)) if m.corner.shape[1] else np.full(6, np.nan)
    columns = {
        "window_sum": m.window_sum.mean(axis=0),
        "window_sum_std": spread,
        "mean": m.mean.mean(axis=0),
        "rms": m.rms.mean(axis=0),
        "max": m.maximum.max(axis=0),
        "corner": corner,
        "settling": np.abs(m.settling[:, -1]).mean(axis=0),
    }
    rows = []
    for k, axis in enumerate(AXES):
        numbers: dict[str, Any] = {name: float(values[k]) for name, values in columns.items()}
        of = _key(run.case, robot)
        rows.append(ErrorRow(**of, axis=axis, unit=UNITS[axis], **numbers, iterations=count))
    return rows


def run_row(run: Run, measures: Measures, robot: str) -> RunRow:
    """Return the row of a run."""
    m = measures
    flags: dict[str, Any] = {name: int(run.flags[name].sum()) for name in FLAGS}
    return RunRow(
        **_key(run.case, robot),
        duration_s=float(m.duration.mean()),
        vibration_m=float(m.shaking.mean()),
        vibration_at_rest_m=float(m.shaking_at_rest.mean()),
        dither_energy_j=float(m.dither_energy.mean()),
        peak_torque_rate_nm_s=float(m.torque_rate.max()),
        **flags,
        goals_missed=int(m.missed.sum()),
        iterations=len(run.accepted),
    )


def _key(case: Case, robot: str) -> dict[str, Any]:
    kt, kr, kn = map(float, case.stiffness)
    return {
        "robot": robot,
        "trajectory": case.trajectory,
        "stiffness_translation": kt,
        "stiffness_rotation": kr,
        "stiffness_nullspace": kn,
        "case": case_name(case),
    }


def write_points(path: str | os.PathLike[str], runs: Iterable[tuple[Run, Measures]]) -> None:
    """Write when goals were accepted and reached and what error was left, `POINT_COLUMNS`."""
    lines: list[tuple[object, ...]] = []
    for run, m in runs:
        accepted, reached = run.accepted.mean(axis=0), run.reached.mean(axis=0)
        for k, error in enumerate(np.abs(m.settling).mean(axis=0)):
            times = (float(accepted[k]), float(reached[k]))
            lines.append((case_name(run.case), k + 1, *times, *map(float, error)))
    write_lines(path, POINT_COLUMNS, lines)


def write_trace(path: str | os.PathLike[str], runs: Iterable[Run]) -> None:
    """Write mean error and standard deviation against time, `TRACE_COLUMNS`."""
    lines: list[tuple[object, ...]] = []
    for run in runs:
        values = np.concatenate(error_against_time(run), axis=1)
        for t, row in zip(run.time, values, strict=True):
            lines.append((case_name(run.case), float(t), *map(float, row)))
    write_lines(path, TRACE_COLUMNS, lines)


def thesis_stiffness() -> list[tuple[float, float, float]]:
    """Return the stiffnesses of Table 4.11, in its order."""
    names = [f"stiffness_{x}" for x in ("translation", "rotation", "nullspace")]
    found = [[float(str(row[name])) for name in names] for row in thesis_table("4.11")]
    return list(dict.fromkeys((kt, kr, kn) for kt, kr, kn in found))


def thesis_final_dither() -> tuple[AmplitudeRow, ...]:
    """Return the dither of thesis 4.2: final amplitudes and frequencies of Table 4.9."""
    rows = {row["joint"]: row for row in thesis_table("4.9")}
    return tuple(
        AmplitudeRow(joint, float(row["frequency_Hz"]), float(row["tau_final_Nm"]))
        for joint, row in sorted(rows.items())
    )
