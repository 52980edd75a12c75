"""Breakaway torques of a Single Joint Experiment: table rows, plots, a line per configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.sje.protocol import Measurement, Protocol
from stiction_envs.experiments.sje.rows import is_base, is_stuck, sje_rows
from stiction_envs.measured import BaseTable, SJERow, write_sje
from stiction_envs.reporting.result import Result


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BreakawayTorques(Result):
    """What an experiment measured, base torques and dithered ones."""

    robot: str
    n: int
    """Joints of the arm."""
    protocol: Protocol
    measurements: tuple[Measurement, ...]
    """By joint, pose and direction, base before dithered."""
    provenance: dict[str, Any]
    file: str = "sje.csv"
    """Name of the table that `write` makes."""
    note: str = ""
    """Stands at the top of the report."""

    @property
    def rows(self) -> list[SJERow]:
        """Rows of the table; a configuration with a stuck iteration has none."""
        return sje_rows(self.measurements, self.robot)

    @property
    def tau(self) -> NDArray[np.float64]:
        """(n, 2, 2) base torques [N·m], signed: joint, load | no load, + | −; NaN if not known."""
        out = np.full((self.n, 2, 2), np.nan)
        for m in self.measurements:
            if is_base(m):
                out[m.job.configuration.index] = m.mean
        return out

    @property
    def base(self) -> BaseTable:
        """The base torques as `tune` and `calibrate` take them.

        Raises:
            StictionError: one of them is not known.
        """
        return BaseTable(self.robot, self.tau)

    @property
    def stuck(self) -> list[Measurement]:
        """Measurements with an iteration that ended before the threshold was reached."""
        return [m for m in self.measurements if is_stuck(m)]

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

    def to_json(self) -> dict[str, Any]:
        """Return robot, rows with the torque of every iteration, and what was stuck."""
        good = [m for m in self.measurements if not is_stuck(m)]
        return {
            "robot": self.robot,
            "rows": [
                {**asdict(row), "iterations_tau_nm": m.tau}
                for row, m in zip(self.rows, good, strict=True)
            ],
            "stuck": [asdict(m.job.configuration) for m in self.stuck],
        }

    def write(
        self, folder: Path, *, progress: Callable[[str, int, int], None] | None = None
    ) -> None:
        """Write the table, a plot per joint, pose and kind, ``report.md`` and ``report.html``.

        Args:
            folder: an existing one.
            progress: called with "plots", plots drawn and their number.

        Raises:
            ExperimentError: everything was stuck; nothing is written.
        """
        from stiction_envs.experiments.sje.plots import plot_sje
        from stiction_envs.experiments.sje.report import write_report

        if not self.rows:
            raise ExperimentError(f"{self.describe_stuck()}: nothing was written")
        write_sje(folder / self.file, self.rows)
        groups: dict[str, list[Measurement]] = {}
        for m in self.measurements:
            c = m.job.configuration
            ending = "" if is_base(m) else "_dither"
            groups.setdefault(f"joint{c.joint}_{c.load}{ending}.png", []).append(m)
        for k, (name, group) in enumerate(groups.items()):
            plot_sje(
                group,
                folder / name,
                robot=self.robot,
                threshold=self.protocol.threshold,
                ramp_rate=self.protocol.ramp_rate,
            )
            if progress is not None:
                progress("plots", k + 1, len(groups))
        write_report(
            folder,
            self.rows,
            robot=self.robot,
            protocol=self.protocol,
            pictures=list(groups),
            stuck=self.describe_stuck(),
            note=self.note,
        )

    def __repr__(self) -> str:
        dithered = sum(not is_base(m) for m in self.measurements)
        text = f"{len(self.measurements) - dithered} base torques, {dithered} with dither"
        return f"<BreakawayTorques of {self.robot}: {text}, {len(self.stuck)} stuck>"

    def __str__(self) -> str:
        return describe([asdict(r) for r in self.rows])


def describe(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows of an SJE table as text, a configuration in a line.

    Args:
        rows: columns of the table by name.
    """
    base = {_key(r): r for r in rows if not r["amplitude_nm"]}
    dithered = {_key(r): r for r in rows if r["amplitude_nm"]}
    lines = [f"{'configuration':<22}{'base τ_b [N·m]':>20}"]
    if dithered:
        lines[0] += f"{'dither':>20}{'τ_SJE [N·m]':>20}{'change':>10}"
    for key in dict.fromkeys([*base, *dithered]):
        joint, load, direction = key
        name = f"Joint {joint} {'Load' if load == 'load' else 'No load'} ({direction})"
        line = f"{name:<22}{_torque(base.get(key)):>20}"
        if dithered:
            row = dithered.get(key)
            if row is None:
                line += f"{'-':>20}"
            else:
                drive = f"{row['frequency_hz']:g} Hz, {row['amplitude_nm']:.3f} N·m"
                line += f"{drive:>20}{_torque(row):>20}"
                change = -100 * row["reduction"]
                line += f"{change:>+8.1f} %" if change == change else f"{'-':>10}"
        lines.append(line.rstrip())
    return "\n".join(lines)


def _key(row: Mapping[str, Any]) -> tuple[int, str, str]:
    return row["joint"], row["load"], row["direction"]


def _torque(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return "stuck"
    spread = "" if row["iterations"] == 1 else f" ± {row['std_nm']:.4f}"
    return f"{row['tau_nm']:+.4f}{spread}"
