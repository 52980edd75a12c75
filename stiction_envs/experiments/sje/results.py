"""Breakaway torques of a Single Joint Experiment: table rows, plots, a line per configuration."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.sje.protocol import POSES, SIGNS, Measurement, Protocol
from stiction_envs.measured.tables import BaseTable, SJERow, write_sje
from stiction_envs.reporting.markdown import aligned, number, percent, signed, table_text
from stiction_envs.reporting.provenance import Provenance
from stiction_envs.reporting.result import Result
from stiction_envs.robots.registry import arm_title


def in_order(measurements: Iterable[Measurement]) -> list[Measurement]:
    """Return measurements by joint, load, no load, +, −, then base before dithered."""

    return sorted(
        measurements,
        key=lambda m: (*m.job.configuration.index, m.job.frequency_hz, m.job.amplitude_nm),
    )


def sje_rows(measurements: Iterable[Measurement], robot: str) -> list[SJERow]:
    """Return one row per measurement without a stuck iteration, in order.

    `reduction` is 1 − |τ|/|τ_base| of the same configuration, 0 for a base row, NaN where no base
    torque is known. `std_nm` is NaN after a single iteration.
    """
    ordered = in_order(measurements)
    base = {m.job.configuration: m.mean for m in ordered if m.is_base}
    rows = []
    for m in ordered:
        if m.is_stuck:
            continue
        c = m.job.configuration
        rows.append(
            SJERow(
                robot=robot,
                joint=c.joint,
                load=c.load,
                direction=c.direction,
                frequency_hz=0.0 if m.is_base else m.job.frequency_hz,
                amplitude_nm=m.job.amplitude_nm,
                tau_nm=m.mean,
                std_nm=m.std if len(m.tau) > 1 else math.nan,
                iterations=len(m.tau),
                reduction=0.0 if m.is_base else 1.0 - abs(m.mean) / abs(base.get(c, math.nan)),
            )
        )
    return rows


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BreakawayTorques(Result):
    """Breakaway torques of an experiment, with and without dither."""

    robot: str
    n: int  # Joints of the arm
    protocol: Protocol
    measurements: tuple[Measurement, ...]  # By joint, pose and direction, base before dithered
    provenance: Provenance
    file: str = "sje.csv"  # Name of the table that `write` makes
    note: str = ""  # Stands at the top of the report
    servo_stiffness: NDArray[np.float64] | None = None  # (n,) of servos [N·m/rad]

    @property
    def rows(self) -> list[SJERow]:
        """Rows of the table; a configuration with a stuck iteration has none."""
        return sje_rows(self.measurements, self.robot)

    @property
    def tau(self) -> NDArray[np.float64]:
        """(n, 2, 2) base torques [N·m], signed: joint, load | no load, + | −; NaN if not known."""
        out = np.full((self.n, 2, 2), np.nan)
        for m in self.measurements:
            if m.is_base:
                out[m.job.configuration.index] = m.mean
        return out

    @property
    def base(self) -> BaseTable:
        """Base torques as `tune` and `calibrate` take them; StictionError if one is not known."""
        return BaseTable(self.robot, self.tau)

    @property
    def stuck(self) -> list[Measurement]:
        """Measurements with an iteration that ended before the threshold was reached."""
        return [m for m in self.measurements if m.is_stuck]

    def describe_stuck(self) -> str:
        """Return which configurations were stuck, one line; empty without any."""
        from stiction_envs.experiments.sje.plots import dither_text

        names = [
            f"joint {m.job.configuration.joint} {m.job.configuration.load} "
            f"({m.job.configuration.direction}) with {dither_text(m.job)}, "
            f"{int(np.isnan(m.tau).sum())} of {len(m.tau)} iterations"
            for m in self.stuck
        ]
        return f"stuck before the threshold was reached: {'; '.join(names)}" if names else ""

    def to_json(self) -> dict[str, object]:
        """Return robot, rows with the torque of every iteration, and what was stuck."""
        good = [m for m in self.measurements if not m.is_stuck]
        return {
            "robot": self.robot,
            "rows": [
                {**asdict(row), "iterations_tau_nm": m.tau}
                for row, m in zip(self.rows, good, strict=True)
            ],
            "stuck": [asdict(m.job.configuration) for m in self.stuck],
            **({} if self.servo_stiffness is None else {"servo_stiffness": self.servo_stiffness}),
        }

    def write(
        self, folder: Path, *, progress: Callable[[str, int, int], None] | None = None
    ) -> None:
        """Write the table, a plot per joint, pose and kind, ``report.md`` and ``report.html``.

        ``progress`` is called with "plots", plots drawn and their number. Raise an ExperimentError
        where everything was stuck; nothing is written then.
        """
        from stiction_envs.experiments.sje.plots import plot_sje

        if not self.rows:
            raise ExperimentError(f"{self.describe_stuck()}: nothing was written")
        write_sje(folder / self.file, self.rows)
        groups: dict[str, list[Measurement]] = {}
        for m in self.measurements:
            c = m.job.configuration
            ending = "" if m.is_base else "_dither"
            groups.setdefault(f"joint{c.joint}_{c.load}{ending}.png", []).append(m)
        for k, (name, group) in enumerate(groups.items()):
            plot_sje(group, folder / name, robot=self.robot, protocol=self.protocol)
            if progress is not None:
                progress("plots", k + 1, len(groups))
        write_report(folder, self, list(groups))

    def __repr__(self) -> str:
        dithered = sum(not m.is_base for m in self.measurements)
        text = f"{len(self.measurements) - dithered} base torques, {dithered} with dither"
        return f"<BreakawayTorques of {self.robot}: {text}, {len(self.stuck)} stuck>"

    def __str__(self) -> str:
        return aligned(*_table(self.rows, self.servo_stiffness))


TEMPLATE = Path(__file__).parent / "templates" / "report.md.j2"
PICTURE = "torques.png"


def write_report(folder: Path, result: BreakawayTorques, pictures: Sequence[str]) -> None:
    """Write both pages and the picture of all torques; ``pictures`` are those of the iterations."""
    from stiction_envs.experiments.sje.plots import plot_torques
    from stiction_envs.reporting.templates import write_md_and_html

    rows, robot, servos = result.rows, result.robot, result.servo_stiffness
    plot_torques(rows, folder / PICTURE, robot=robot)
    by_joint: dict[int, list[float]] = {}
    for row in rows:
        if row.amplitude_nm and np.isfinite(row.reduction):
            by_joint.setdefault(row.joint, []).append(100 * row.reduction)
    reductions = {joint: float(np.mean(values)) for joint, values in by_joint.items()}
    by_torque = sorted(rows, key=lambda row: abs(row.tau_nm))
    write_md_and_html(
        folder,
        TEMPLATE,
        f"Breakaway torques of {arm_title(robot)}",
        note=result.note,
        robot=arm_title(robot),
        dithered=bool(reductions),
        mean=float(np.mean(list(reductions.values()))) if reductions else 0.0,
        reductions=reductions,
        best=max(reductions, key=reductions.__getitem__, default=0),
        least=min(reductions, key=reductions.__getitem__, default=0),
        worse=sorted(joint for joint, value in reductions.items() if value < 0),
        count=len({(row.joint, row.load, row.direction) for row in rows}),
        weakest=by_torque[0].joint,
        strongest=by_torque[-1].joint,
        lowest=abs(by_torque[0].tau_nm),
        highest=abs(by_torque[-1].tau_nm),
        iterations=max(row.iterations for row in rows),
        protocol=result.protocol,
        table=table_text(*_table(rows, servos)),
        servos=servos is not None,
        pictures=list(pictures),
        stuck=result.describe_stuck(),
    )


def _table(
    rows: Sequence[SJERow], stiffness: NDArray[np.float64] | None
) -> tuple[list[str], list[list[str]]]:
    """Return header and cells of the table of all torques."""
    header = ["joint", "pose", "direction", "dither", "τ [N·m]", "std [N·m]", "change"]
    cells = [
        [
            str(row.joint),
            POSES[row.load],
            SIGNS[row.direction],
            f"{row.frequency_hz:g} Hz, {row.amplitude_nm:.3g} N·m" if row.amplitude_nm else "–",
            signed(row.tau_nm, 4),
            number(row.std_nm, 4),
            percent(-100 * row.reduction) if row.amplitude_nm else "",
        ]
        for row in rows
    ]
    if stiffness is not None:
        header[5:5] = ["τ/K [mrad]", "dither A/K [mrad]"]
        for row, line in zip(rows, cells, strict=True):
            angle = 1e3 / float(stiffness[row.joint - 1])
            shaken = number(row.amplitude_nm * angle, 1) if row.amplitude_nm else "–"
            line[5:5] = [signed(row.tau_nm * angle, 1), shaken]
    return header, cells
