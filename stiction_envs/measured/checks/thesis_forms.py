"""Rules on the thesis's other tables: errors of paths (4.11), line fits (A.1), dynamics (4.1)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from statistics import fmean

from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.rules import (
    Defect,
    Row,
    number,
    place,
    rounding,
)
from stiction_envs.measured.thesis_robots import our_name

LEAST_R2 = 0.1
"""Below it a line explains less than a tenth of the torque's variance: no fit to speak of."""
LARGEST_FIT = 2.0
"""Times the mean breakaway torque of the poses that a line's intercept can be: sliding friction is
at most the breakaway torque, twice leaves room for the gravity residue of single poses."""
LARGEST_VISCOUS = 1000.0
"""[N·m·s/rad]; at 1 rad/s more than an iiwa 14 can drive (320 N·m)."""
_LENGTHS = ("m", "cm", "mm", "m·samples", "mm·samples", "m·s", "mm·s")
_ANGLES = ("rad", "deg", "°", "rad·samples", "deg·samples", "rad·s", "deg·s")
_AXIS_UNITS = dict.fromkeys("xyz", _LENGTHS) | dict.fromkeys(("roll", "pitch", "yaw"), _ANGLES)
"""Units an error along or about an axis can have, or its sum over samples or time."""


def check_fits(
    rows: Iterable[Row],
    table: str = "",
    bases: Mapping[tuple[str, int, str, str], str] | None = None,
) -> list[Defect]:
    """Line fits torque = intercept + slope × speed, as in table A.1.

    ``intercept_Nm`` (N·m) has the sign of its ``direction`` and is no larger than
    `LARGEST_FIT` times the breakaway torque; ``r2`` (no unit) is not near zero.

    Args:
        rows: the fits.
        table: name for the report.
        bases: printed base torques, N·m, by `setting_key`; their mean over the poses counts.
    """
    rows, breakaway = list(rows), defaultdict[tuple[str, int, str], list[float]](list)
    for (robot, joint, _, direction), raw in (bases or {}).items():
        breakaway[robot, joint, direction].append(abs(float(raw)))
    found, weak = [], []
    for row in rows:
        intercept, r2 = number(row, "intercept_Nm"), number(row, "r2")
        where, text = f"{place(row)}, intercept", str(row["intercept_Nm"])
        sign = 1 if row["direction"] == "+" else -1
        key = our_name(str(row["robot"])), int(number(row, "joint")), str(row["direction"])
        base = fmean(breakaway[key]) if key in breakaway else None
        if intercept * sign <= 0:
            expected = "> 0" if sign > 0 else "< 0"
            message = "friction along the motion: sign against the direction"
            found.append(Defect(table, where, text, expected, "implausible", message))
        elif base is not None and abs(float(intercept)) > LARGEST_FIT * base:
            expected = f"at most {LARGEST_FIT:g} × {base:.4f}"
            message = "size: more than the joint needs to break away"
            found.append(Defect(table, where, text, expected, "implausible", message))
        if float(r2) < LEAST_R2:
            message = "the line explains under a tenth of the variance"
            where, expected = f"{place(row)}, r2", f">= {LEAST_R2:g}"
            weak.append(Defect(table, where, str(row["r2"]), expected, "implausible", message))
    if weak and len(weak) == len(rows) > 1:
        most = max(rows, key=lambda r: number(r, "r2"))["r2"]
        message = f"r2 is at most {most}: the lines explain under a tenth of the variance"
        return [*collapse(weak, len(rows), f"r2 >= {LEAST_R2:g}", message), *found]
    return found + weak


def check_parameters(
    rows: Sequence[Row],
    table: str = "",
    *,
    total_kg: Mapping[str, float] | None = None,
    start_kg: Mapping[str, Mapping[int, float]] | None = None,
) -> list[Defect]:
    """Identified dynamic parameters, as in table 4.1: ``quantity``, ``value``.

    Each ``mass`` (kg) is positive and their sum between half of the arm's weight (the base does not
    move) and all of it; ``viscous`` (N·m·s/rad) is no larger than `LARGEST_VISCOUS`. Signs of
    the friction terms are the regressor's convention and not judged.

    Args:
        rows: one parameter each; a mass printed twice counts once.
        table: name for the report.
        total_kg: weight of the arm, by robot (our name); not there, no sum is judged.
        start_kg: masses the fit was started with, by robot and joint; a mass that came back
            unchanged was not identified, which is a remark.
    """
    found = []
    masses: dict[tuple[str, int], Decimal] = {}
    for row in rows:
        at = our_name(str(row["robot"])), int(number(row, "joint"))
        where = f"{row['robot']} link {row['joint']}, {row['quantity']}"
        value, text = number(row, "value"), f"{row['value']} {row['unit']}"
        if row["quantity"] == "viscous" and abs(value) > LARGEST_VISCOUS:
            expected, message = f"within ±{LARGEST_VISCOUS:g}", "no drive could turn such a joint"
            found.append(Defect(table, where, text, expected, "implausible", message))
        if row["quantity"] != "mass" or at in masses:
            continue
        masses[at] = value
        start = (start_kg or {}).get(at[0], {}).get(at[1])
        if value <= 0:
            message = "a mass is positive"
            found.append(Defect(table, where, text, "> 0 kg", "implausible", message))
        elif start is not None and abs(value - Decimal(str(start))) <= rounding(value):
            message = "came back as the starting value: not identified"
            found.append(Defect(table, where, text, "a fitted value", "remark", message))
    for robot, total in (total_kg or {}).items():
        kg = [m for (name, _), m in masses.items() if name == robot]
        if kg and not total / 2 <= float(sum(kg)) <= total:
            text, expected = f"{float(sum(kg)):.1f} kg", f"{total / 2:g} to {total:g} kg"
            message = "the links together against the weight of the arm"
            where = f"{robot}, sum of masses"
            found.append(Defect(table, where, text, expected, "implausible", message))
    return found


def check_differences(rows: Iterable[Row], table: str = "") -> list[Defect]:
    """``diff`` is ``mean_error_dither`` − ``mean_error_no_dither``, all in the unit of the axis.

    Off by no more than the three numbers' rounding it is a remark, by more a defect.
    """
    found = []
    for row in rows:
        one, two = number(row, "mean_error_dither"), number(row, "mean_error_no_dither")
        diff = number(row, "diff")
        off = diff - (one - two)
        if off:
            within = abs(off) <= rounding(one) + rounding(two) + rounding(diff)
            kind, note = ("remark", ", rounding") if within else ("difference", "")
            message = f"diff is off by {abs(off)}{note}"
            expected = f"{one - two:+}"
            found.append(Defect(table, axis(row), str(row["diff"]), expected, kind, message))
    return found


def check_growth(rows: Iterable[Row], table: str = "") -> list[Defect]:
    """Errors that dither made larger: data, hence remarks."""
    message = "dither made the error larger"
    return [
        Defect(table, axis(r), str(r["diff"]), "< 0", "remark", message)
        for r in rows
        if number(r, "mean_error_dither") > number(r, "mean_error_no_dither")
    ]


def check_units(rows: Iterable[Row], table: str = "") -> list[Defect]:
    """``unit_printed`` is a length for axes x, y, z and an angle for roll, pitch, yaw."""
    rows = list(rows)
    found = []
    for row in rows:
        units = _AXIS_UNITS.get(str(row["axis"]))
        if units is None:
            names = ", ".join(_AXIS_UNITS)
            raise StictionError(f"unknown axis {row['axis']!r}: expected one of {names}")
        if row["unit_printed"] not in units:
            name = "a length" if row["axis"] in "xyz" else "an angle"
            message = f"an error of this axis is {name}, summed over samples or not"
            printed = str(row["unit_printed"])
            found.append(Defect(table, axis(row), printed, units[0], "unit", message))
    message = "x, y, z are lengths and roll, pitch, yaw angles, summed over samples or not"
    return collapse(found, len(rows), "m and rad", message)


def axis(row: Row) -> str:
    """Where a row of Cartesian errors is, such as ``b roll``."""
    return " ".join(str(row[c]) for c in ("subtable", "axis") if c in row)


def collapse(found: list[Defect], n: int, expected: str, message: str) -> list[Defect]:
    """One defect for ``all`` where each of ``n`` > 1 rows has it."""
    if n < 2 or len(found) < n:
        return found
    different = list(dict.fromkeys(d.printed for d in found))
    printed = different[0] if len(different) == 1 else f"{len(found)} values"
    return [Defect(found[0].table, "all", printed, expected, found[0].kind, message)]
