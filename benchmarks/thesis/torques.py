"""Breakaway torques simulated beside measured: Tables 4.3 and 4.5 to 4.10."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.thesis.items import Found, Needs, Table
from benchmarks.thesis.nested_models.cells import FREQUENCIES, cells, repeat_floor
from stiction_envs.experiments.sje.protocol import (
    SIGNS,
    Configuration,
    Job,
    Measurement,
    configurations,
)
from stiction_envs.measured.tables import AmplitudeRow, our_name
from stiction_envs.measured.thesis_tables import (
    DitheredRow,
    thesis_base,
    thesis_dithered,
    thesis_robots,
    thesis_table,
)
from stiction_envs.reporting.markdown import number, signed
from stiction_envs.robots import load_arm
from tuning.protocol.stages import Choice, change, final_amplitude

ROBOTS = tuple(thesis_robots())
(TUNED,) = thesis_robots("4.9")
"""The arm whose dither the thesis tuned."""
SCALES = (0.8, 1.0, 1.2)
"""Amplitudes of Tables 4.6 to 4.8, over the base torque."""


# ---- jobs ----------------------------------------------------------------------------------------


def job_of(row: DitheredRow) -> Job:
    """Return the job that measures a printed cell."""
    c = Configuration(row.joint, row.load, row.direction)
    return Job(c, row.frequency_hz, row.amplitude_nm)


def cells_of(table: str) -> list[DitheredRow]:
    """Return the printed cells of a table with dither, in its order."""
    (robot,) = thesis_robots(table)
    return [r for r in thesis_dithered(robot) if r.table == table]


def base_jobs(joints: list[int] | None = None) -> list[Job]:
    """Return the jobs without dither."""
    return [Job(c) for c in configurations(7, joints)]


def grid() -> dict[tuple[Configuration, float, float], Job]:
    """Return the jobs of Tables 4.6 to 4.8, and those left out there, of `TUNED`.

    By configuration, frequency [Hz] and scale.
    """
    first = {job_of(r).configuration: abs(r.tau_base_nm) for r in cells_of("4.6")}
    return {
        (c, f, s): Job(c, f, s * tau)
        for c, tau in first.items()
        for f in FREQUENCIES
        for s in SCALES
    }


def torque_needs(table: str) -> Needs:
    """Return what a table needs: robot and job of its cells, base torques too."""
    if table == "4.3":
        return {"sje": [(robot, job) for robot in ROBOTS for job in base_jobs()]}
    (robot,) = thesis_robots(table)
    jobs = list(grid().values()) if table == "4.9" else [job_of(r) for r in cells_of(table)]
    base = [Job(j.configuration) for j in jobs]
    return {"sje": [(robot, j) for j in dict.fromkeys([*base, *jobs])]}


def configuration_name(c: Configuration, robot: str = "") -> str:
    """Return ``Panda 1 load (+)``."""
    return f"{robot} {c.joint} {c.load.replace('_', ' ')} ({SIGNS[c.direction]})".strip()


def torque_text(value: float, digits: int) -> str:
    """Return a signed number; ``stuck`` for NaN."""
    return "stuck" if math.isnan(value) else signed(value, digits)


# ---- rows ----------------------------------------------------------------------------------------


def simulated_columns(m: Measurement, change_pct: float, difference: float) -> dict[str, float]:
    """Return the simulation's columns of the CSV; one iteration has no standard deviation."""
    return {
        "simulated_tau_Nm": m.mean,
        "simulated_std_Nm": m.std if len(m.tau) > 1 else math.nan,
        "simulated_change_pct": change_pct,
        "difference_points": difference,
    }


@dataclass(frozen=True, kw_only=True)
class TorqueRow:
    """One printed torque with dither and the simulation's."""

    printed: Mapping[str, Any]
    """The row as the thesis has it."""
    cell: DitheredRow
    """The same as a cell."""
    simulated: Measurement
    """The same simulated; the mean torque is NaN if an iteration was stuck."""
    base: Measurement
    """Without dither."""

    @property
    def column(self) -> str:
        """Column on the page: the frequency, or in Table 4.10 the set of amplitudes."""
        r = self.cell
        return r.amplitude_set if r.table == "4.10" else f"{r.frequency_hz:g} Hz"

    @property
    def simulated_change_pct(self) -> float:
        """Against the simulated base torque [%]."""
        return change(self.simulated, self.base)

    @property
    def difference(self) -> float:
        """Simulated less measured change, in points of the base torque."""
        return self.simulated_change_pct - self.cell.change_pct

    def line(self) -> dict[str, Any]:
        """Return the CSV's line."""
        columns = simulated_columns(self.simulated, self.simulated_change_pct, self.difference)
        return {**self.printed, "simulated_tau_base_Nm": self.base.mean, **columns}


def rows_of_table(table: str, measured: Mapping[tuple[str, Job], Measurement]) -> list[TorqueRow]:
    """Return the rows of Table 4.5 to 4.8 or 4.10, in its order."""
    (robot,) = thesis_robots(table)
    # Table 4.10's printed rows alternate between the sets of amplitudes, as the cells do
    return [
        TorqueRow(
            printed=printed,
            cell=cell,
            simulated=measured[robot, job_of(cell)],
            base=measured[robot, Job(job_of(cell).configuration)],
        )
        for printed, cell in zip(thesis_table(table), cells_of(table), strict=True)
    ]


# ---- tables --------------------------------------------------------------------------------------


def table_4_3(found: Found) -> Table:
    """Return Table 4.3."""
    lines, shown, off = [], [], []
    for r in thesis_table("4.3"):
        robot = our_name(r["robot"])
        c, torque = Configuration(r["joint"], r["load"], r["direction"]), r["tau_base_Nm"]
        m = found["sje"][robot, Job(c)]
        off.append(100.0 * (m.mean / torque - 1.0))
        lines.append({**r, **simulated_columns(m, 0.0, off[-1])})
        texts = signed(torque, 4), torque_text(m.mean, 4), f"{torque_text(off[-1], 2)} %"
        shown.append([configuration_name(c, thesis_robots()[robot]), *texts])
    mean = f"{number(float(np.nanmean(np.abs(off))))} % off (calibrated)"
    return Table(
        rows=lines,
        header=["robot, joint, pose, direction", "measured [N·m]", "simulated [N·m]", "difference"],
        shown=shown,
        compared=mean,
    )


def compare(rows: Sequence[TorqueRow]) -> str:
    """Return how dithered rows compare; the one broken cell counts nowhere."""
    sound = [r for r in rows if not r.cell.outlier]
    good = [r for r in sound if math.isfinite(r.difference)]
    if not good:
        return "never moved"
    gap = np.abs([r.difference for r in good])
    nothing = np.abs([r.cell.change_pct for r in good]).mean()
    text = f"{number(gap.mean())} points off (no effect: {number(nothing)}, repeats: "
    text += f"{number(repeat_floor(cells())[0])})"
    stuck = len(sound) - len(good)
    return f"{text}; {stuck} of {len(sound)} cells never moved" if stuck else text


def dithered_table(number: str, found: Found) -> Table:
    """Return Table 4.5, 4.6, 4.7, 4.8 or 4.10."""
    rows = rows_of_table(number, found["sje"])
    base = thesis_base(rows[0].cell.robot)
    columns = list(dict.fromkeys(r.column for r in rows))
    by_configuration: dict[Configuration, dict[str, TorqueRow]] = {}
    for r in rows:
        by_configuration.setdefault(r.simulated.job.configuration, {})[r.column] = r
    shown = []
    for c, mine in by_configuration.items():
        measured = signed(base.tau[c.index], 3)
        line = [configuration_name(c), measured]
        line.append(torque_text(next(iter(mine.values())).base.mean, 3))
        for column in columns:
            if column not in mine:
                line += ["", "", ""]
                continue
            r = mine[column]
            line += [
                f"{signed(r.cell.tau_sje_nm, 3)} ({signed(r.cell.change_pct, 1)})"
                + (" †" if r.cell.outlier else ""),
                f"{torque_text(r.simulated.mean, 3)} ({torque_text(r.simulated_change_pct, 1)})",
                torque_text(r.difference, 1),
            ]
        shown.append(line)
    header = ["joint, pose, direction", "base [N·m]: measured", "simulated"]
    for column in columns:
        header += [f"{column}: measured [N·m] (%)", "simulated (%)", "difference [points]"]
    return Table(rows=[r.line() for r in rows], header=header, shown=shown, compared=compare(rows))


# ---- chosen settings -----------------------------------------------------------------------------


def choose(joint: int, measured: Mapping[Job, Measurement]) -> Choice:
    """Apply the thesis's choices (4.2) to one joint's simulated torques.

    The best frequency at scale 1.0, the best scale there, the final amplitude by the tuner's rule.
    """
    jobs, mine = grid(), configurations(7, [joint])

    def mean(f: float, s: float) -> float:
        return float(np.mean([change(measured[jobs[c, f, s]], measured[Job(c)]) for c in mine]))

    frequency = min(FREQUENCIES, key=lambda f: mean(f, 1.0))
    scale = min(SCALES, key=lambda s: mean(frequency, s))
    base = thesis_base(TUNED)
    intermediate = scale * np.abs(base.tau[joint - 1])
    amplitude, reason = final_amplitude(
        intermediate,
        float(base.friction[joint - 1].min()),
        frequency_hz=frequency,
        torque_rate=float(load_arm(TUNED).limits.torque_rate[joint - 1]),
    )
    row = AmplitudeRow(joint, frequency, amplitude)
    return Choice(row=row, scale=scale, intermediate=intermediate, reason=reason)


def table_4_9(found: Found) -> Table:
    """Return Table 4.9: the thesis's rules on simulated torques."""
    measured = {job: m for (robot, job), m in found["sje"].items() if robot == TUNED}
    choices = {joint: choose(joint, measured) for joint in range(1, 8)}
    return compare_choices(choices)


def compare_choices(choices: Mapping[int, Choice]) -> Table:
    """Return Table 4.9 with choices by joint."""
    lines, shown = [], {}
    same = np.zeros(3, dtype=int)
    for printed in thesis_table("4.9"):
        joint, c = printed["joint"], choices[printed["joint"]]
        base, final = printed["tau_base_Nm"], abs(printed["tau_final_Nm"])
        f, amplitude = c.row.frequency_hz, c.row.amplitude_nm
        gap = amplitude - final
        values = {
            k: {True: "yes", False: "no"}[x] if isinstance(x, bool) else x
            for k, x in printed.items()
        }
        lines.append(
            {
                **values,
                "simulated_frequency_Hz": f,
                "simulated_scale": c.scale,
                "simulated_tau_intermediate_Nm": math.copysign(c.scale * abs(base), base),
                "simulated_tau_final_Nm": amplitude,
                "difference_final_Nm": gap,
            }
        )
        if joint in shown:  # a line of print per configuration
            continue
        scale = 1.2 if joint == 3 else printed["scale"]  # joint 3's is a misprint
        settings = (printed["frequency_Hz"], scale, final), (f, c.scale, amplitude)
        texts = [f"{x:g}, {y:g}, {z:.4f}" for x, y, z in settings]
        shown[joint] = [str(joint), *texts, signed(gap, 4), c.reason]
        frequency = f == printed["frequency_Hz"]
        same += [frequency, c.scale == scale, abs(gap) <= 0.05 * final]
    brief = f"{same[0]} of {len(shown)} frequencies, {same[1]} scales, {same[2]} amplitudes to 5 %"
    return Table(
        rows=lines,
        header=["joint", "measured: f [Hz], scale, A [N·m]", "simulated", "difference of A", "why"],
        shown=shown.values(),
        compared=brief,
    )
