"""Rules on the thesis's other tables: errors of paths (4.11), line fits (A.1), dynamics (4.1)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from decimal import Decimal
from statistics import fmean

from stiction_envs.errors import unknown
from stiction_envs.measured.checks.rules import (
    Bases,
    Defect,
    Row,
    number,
    place,
    rounding,
    sign_of,
)
from stiction_envs.measured.thesis_robots import our_name, thesis_robots

LEAST_R2 = 0.1
"""A line with less explains under a tenth of the torque's variance: no fit [-]; assumed."""
LARGEST_FIT = 2.0
"""Largest intercept of a line over the mean breakaway torque of the poses [-]. Source: sliding
friction is at most the breakaway torque; twice leaves room for the gravity residue of a pose."""
LARGEST_VISCOUS = 1000.0
"""[N·m·s/rad]. Source: at 1 rad/s more than an iiwa 14 can drive (320 N·m)."""
_LENGTHS = ("m", "cm", "mm", "m·samples", "mm·samples", "m·s", "mm·s")
_ANGLES = ("rad", "deg", "°", "rad·samples", "deg·samples", "rad·s", "deg·s")
_AXIS_UNITS = dict.fromkeys("xyz", _LENGTHS) | dict.fromkeys(("roll", "pitch", "yaw"), _ANGLES)
"""Units an error along or about an axis can have, or its sum over samples or time."""


def check_fits(rows: Sequence[Row], bases: Bases | None = None) -> Iterator[Defect]:
    """Line fits torque = intercept + slope × speed, as in table A.1.

    ``intercept_Nm`` (N·m) has the sign of its ``direction`` and is no larger than
    `LARGEST_FIT` times the breakaway torque; ``r2`` (no unit) is not near zero.

    Args:
        rows: the fits.
        bases: printed base torques [N·m]; their mean over the poses counts.
    """
    weak = [
        Defect(
            f"{place(row)}, r2",
            str(row["r2"]),
            f">= {LEAST_R2:g}",
            "implausible",
            "the line explains under a tenth of the variance",
        )
        for row in rows
        if float(number(row, "r2")) < LEAST_R2
    ]
    all_weak = len(weak) == len(rows) > 1
    if all_weak:
        most = max(rows, key=lambda r: number(r, "r2"))["r2"]
        message = f"r2 is at most {most}: the lines explain under a tenth of the variance"
        yield from _collapsed(weak, len(rows), f"r2 >= {LEAST_R2:g}", message)
    for row in rows:
        intercept, (sign, expected) = number(row, "intercept_Nm"), sign_of(row)
        key = our_name(str(row["robot"])), int(number(row, "joint")), str(row["direction"])
        poses = [abs(float(x)) for (*of, _, d), x in (bases or {}).items() if (*of, d) == key]
        if intercept * sign <= 0:
            message = "friction along the motion: sign against the direction"
        elif poses and abs(float(intercept)) > LARGEST_FIT * fmean(poses):
            expected = f"at most {LARGEST_FIT:g} × {fmean(poses):.4f}"
            message = "size: more than the joint needs to break away"
        else:
            continue
        where = f"{place(row)}, intercept"
        yield Defect(where, str(row["intercept_Nm"]), expected, "implausible", message)
    if not all_weak:
        yield from weak


def check_parameters(rows: Sequence[Row]) -> Iterator[Defect]:
    """Identified dynamic parameters, as in table 4.1: ``quantity``, ``value``.

    Each ``mass`` (kg) is positive. Of an arm of the thesis, the sum is between half of its weight
    (the base does not move) and all of it; a mass that came back as the fit's starting value was
    not identified, which is a remark. A mass printed twice counts once. ``viscous`` (N·m·s/rad) is
    no larger than `LARGEST_VISCOUS`. Signs of the friction terms are the regressor's convention
    and not judged.
    """
    masses: dict[str, dict[int, Decimal]] = {}
    for row in rows:
        robot, joint = our_name(str(row["robot"])), int(number(row, "joint"))
        where = f"{row['robot']} link {row['joint']}, {row['quantity']}"
        value, text = number(row, "value"), f"{row['value']} {row['unit']}"
        if row["quantity"] == "viscous" and abs(value) > LARGEST_VISCOUS:
            expected, message = f"within ±{LARGEST_VISCOUS:g}", "no drive could turn such a joint"
            yield Defect(where, text, expected, "implausible", message)
        if row["quantity"] != "mass" or joint in masses.get(robot, ()):
            continue
        masses.setdefault(robot, {})[joint] = value
        start = thesis_robots()[robot].start_kg.get(joint) if robot in thesis_robots() else None
        if value <= 0:
            yield Defect(where, text, "> 0 kg", "implausible", "a mass is positive")
        elif start is not None and abs(value - Decimal(str(start))) <= rounding(value):
            message = "came back as the starting value: not identified"
            yield Defect(where, text, "a fitted value", "remark", message)
    for robot, known in thesis_robots().items():
        total, kg = known.weight_kg, float(sum(masses.get(robot, {}).values()))
        if total is not None and robot in masses and not total / 2 <= kg <= total:
            where, expected = f"{robot}, sum of masses", f"{total / 2:g} to {total:g} kg"
            message = "the links together against the weight of the arm"
            yield Defect(where, f"{kg:.1f} kg", expected, "implausible", message)


def check_differences(rows: Sequence[Row]) -> Iterator[Defect]:
    """``diff`` is ``mean_error_dither`` − ``mean_error_no_dither``, all in the unit of the axis.

    Off by no more than the three numbers' rounding it is a remark, by more a defect.
    """
    for row in rows:
        one, two = number(row, "mean_error_dither"), number(row, "mean_error_no_dither")
        diff = number(row, "diff")
        off = abs(diff - (one - two))
        if off:
            within = off <= rounding(one) + rounding(two) + rounding(diff)
            kind, note = ("remark", ", rounding") if within else ("difference", "")
            message = f"diff is off by {off}{note}"
            yield Defect(_axis(row), str(row["diff"]), f"{one - two:+}", kind, message)


def check_growth(rows: Sequence[Row]) -> Iterator[Defect]:
    """Errors that dither made larger: data, hence remarks."""
    for row in rows:
        if number(row, "mean_error_dither") > number(row, "mean_error_no_dither"):
            message = "dither made the error larger"
            yield Defect(_axis(row), str(row["diff"]), "< 0", "remark", message)


def check_units(rows: Sequence[Row]) -> list[Defect]:
    """``unit_printed`` is a length for axes x, y, z and an angle for roll, pitch, yaw."""
    found = []
    for row in rows:
        axis, printed = str(row["axis"]), str(row["unit_printed"])
        if axis not in _AXIS_UNITS:
            raise unknown("axis", axis, _AXIS_UNITS)
        if printed not in _AXIS_UNITS[axis]:
            name = "a length" if axis in "xyz" else "an angle"
            message = f"an error of this axis is {name}, summed over samples or not"
            found.append(Defect(_axis(row), printed, _AXIS_UNITS[axis][0], "unit", message))
    message = "x, y, z are lengths and roll, pitch, yaw angles, summed over samples or not"
    return _collapsed(found, len(rows), "m and rad", message)


def _axis(row: Row) -> str:
    """Where a row of Cartesian errors is, such as ``b roll``."""
    return " ".join(str(row[c]) for c in ("subtable", "axis") if c in row)


def _collapsed(found: list[Defect], n: int, expected: str, message: str) -> list[Defect]:
    """One defect for ``all`` where each of ``n`` > 1 rows has it."""
    if n < 2 or len(found) < n:
        return found
    different = list(dict.fromkeys(d.printed for d in found))
    printed = different[0] if len(different) == 1 else f"{len(found)} values"
    return [Defect("all", printed, expected, found[0].kind, message)]
