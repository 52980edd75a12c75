"""The printed tables of the thesis, as typed rows.

The CSVs in ``thesis/`` stand as printed, misprints included, and :func:`thesis_table` returns the
tables so. :func:`thesis_dithered` corrects two misprints (joint 3's scale in 4.9 is 1.2, not 1.0;
joint 5's no-load + intermediate amplitude is 1.2 × base) and marks one bad measurement.

Source: S. Monzó Martínez, A. Zejnullahu, MSc thesis TFRT-6202, Lund University, 2023.
"""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stiction_envs.errors import unknown
from stiction_envs.measured.tables import BaseTable, our_name, read_base

THESIS_TABLES = (*(f"4.{i}" for i in range(1, 12)), "A.1")
"""Numbers of the tables: 4.1, 4.2, … 4.11, A.1."""
Cells = dict[str, Any]
_TEXT = {"robot", "load", "direction", "subtable", "quantity", "unit", "printed"}
_TEXT |= {"amplitude_set", "trajectory", "axis", "unit_printed"}


_ROBOTS = {
    "panda": ("Panda", ("4.2", "4.3", "4.4", *(f"4.{i}" for i in range(6, 12)), "A.1")),
    "iiwa7": ("iiwa", ("4.1", "4.3", "4.5")),
}
"""Arms by our names: their titles in headings about the thesis, and the tables that have them."""


def thesis_robots(table: str | None = None) -> dict[str, str]:
    """Return titles of the thesis's arms by our names, or only of arms that one table has."""
    return {k: title for k, (title, tables) in _ROBOTS.items() if table is None or table in tables}


@dataclass(frozen=True)
class DitheredRow:
    """One dithered breakaway measurement of the thesis."""

    robot: str
    joint: int
    """From 1."""
    load: str
    direction: str
    frequency_hz: float
    """Dither frequency, Hz; in 4.10 that of the joint in 4.9."""
    scale: float
    """Dither amplitude / abs(base torque) of the same pose and direction."""
    amplitude_nm: float
    """Dither amplitude, N·m: scale × base, in the final rows of 4.10 the amplitude of 4.9."""
    tau_base_nm: float
    """Base torque the percentage refers to, signed, N·m."""
    tau_sje_nm: float
    """Torque with dither, signed, N·m."""
    change_pct: float
    """Printed change in percent; negative: less torque needed."""
    table: str
    """``4.5`` (iiwa), ``4.6``, ``4.7``, ``4.8`` or ``4.10``."""
    amplitude_set: str
    """``scale``; in 4.10 ``intermediate`` or ``final``."""
    outlier: bool
    """True for the one reading that its own repetition refutes (4.7, joint 2 load −, 30 Hz)."""


def thesis_table(number: str) -> list[Cells]:
    """Return the rows of a printed table, such as ``"4.6"``, in the units of its columns.

    ``joint`` is an int, ``final_set_by_hand`` a bool, names are text, everything else is a float.
    """
    with thesis_file(number).open(encoding="utf-8", newline="") as file:
        return [{k: _cell(k, text) for k, text in row.items()} for row in csv.DictReader(file)]


def _cell(column: str, text: str) -> Any:
    if column in _TEXT:
        return text
    if column == "final_set_by_hand":
        return text == "yes"
    return int(text) if column == "joint" else float(text)


def thesis_base(robot: str) -> BaseTable:
    """Return the base torques of table 4.3 [N·m]: ``panda`` or ``iiwa7`` (``iiwa`` in print)."""
    return read_base(thesis_file("4.3"), _measured(robot))


def thesis_dithered(robot: str = "panda") -> list[DitheredRow]:
    """Return every dithered breakaway torque: ``panda`` 4.6, 4.7, 4.8 and 4.10, ``iiwa7`` 4.5."""
    robot = _measured(robot)
    if robot in thesis_robots("4.5"):
        return [
            _dithered(row, "4.5", row["tau_base_Nm"], row["frequency_Hz"], row["scale"])
            for row in thesis_table("4.5")
        ]
    bases = {_key(row): row["tau_base_Nm"] for row in thesis_table("4.6")}
    rows = [
        _dithered(row, number, bases[_key(row)], row["frequency_Hz"], row["scale"])
        for number in ("4.6", "4.7", "4.8")
        for row in thesis_table(number)
    ]
    chosen = {_key(row): row for row in thesis_table("4.9")}
    for row in thesis_table("4.10"):
        choice = chosen[_key(row)]
        scale = 1.2 if row["joint"] == 3 else choice["scale"]
        final = choice["tau_final_Nm"] if row["amplitude_set"] == "final" else None
        base, frequency = row["tau_base_Nm"], choice["frequency_Hz"]
        rows.append(_dithered(row, "4.10", base, frequency, scale, final))
    return rows


def _dithered(
    row: Cells,
    table: str,
    base: float,
    frequency: float,
    scale: float,
    amplitude: float | None = None,
) -> DitheredRow:
    """Return a row of a table whose amplitude is scale × base, or ``amplitude`` [N·m]."""
    return DitheredRow(
        *_key(row),
        frequency_hz=frequency,
        scale=scale if amplitude is None else amplitude / abs(base),
        amplitude_nm=scale * abs(base) if amplitude is None else amplitude,
        tau_base_nm=base,
        tau_sje_nm=row["tau_sje_Nm"],
        change_pct=row["change_pct"],
        table=table,
        amplitude_set=row.get("amplitude_set", "scale"),
        outlier=table == "4.7" and row["change_pct"] == -94.27,
    )


def _key(row: Cells) -> tuple[str, int, str, str]:
    return our_name(row["robot"]), row["joint"], row["load"], row["direction"]


def _measured(robot: str) -> str:
    """Return our name of a robot that the thesis measured."""
    if our_name(robot) not in thesis_robots():
        raise unknown("robot of the thesis", robot, thesis_robots())
    return our_name(robot)


def thesis_file(number: str) -> Path:
    """Return the CSV of a printed table.

    Raises:
        StictionError: no such table.
    """
    if number not in THESIS_TABLES:
        raise unknown("thesis table", number, THESIS_TABLES)
    return Path(__file__).parent / "thesis" / f"table_{number.replace('.', '_')}.csv"
