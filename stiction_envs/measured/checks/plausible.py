"""Rules on what measured and fitted numbers can be: SJE tables, line fits, dynamic parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal

from stiction_envs.measured.checks.rules import (
    Defect,
    Row,
    check_signs,
    collapse,
    number,
    place,
    rounding,
    setting_key,
)
from stiction_envs.measured.settings import TableCheckSettings, measured_settings
from stiction_envs.measured.thesis_robots import our_name


def check_sje(
    rows: Iterable[Row], table: str = "", *, settings: TableCheckSettings | None = None
) -> list[Defect]:
    """A table in the form of :func:`~stiction_envs.measured.read_sje`.

    ``tau_nm`` (N·m) has the sign of ``direction``; ``reduction`` is 1 − abs(tau_nm)/abs(base) with
    a base row (no dither) of the same robot, joint, pose and direction, up to the printed digits;
    rows of the same setting do not contradict. ``nan`` and rows without a base row pass.
    """
    s = settings or measured_settings().table_checks
    rows = list(rows)
    found = check_signs(rows, ["tau_nm"], table)
    bases: dict[tuple[str, int, str, str], list[Decimal]] = {}
    for row in rows:
        tau = number(row, "tau_nm")
        if number(row, "frequency_hz") == number(row, "amplitude_nm") == 0 and tau != 0:
            bases.setdefault(setting_key(row), []).append(tau)
    first: dict[tuple[object, ...], Row] = {}
    for row in rows:
        drive = number(row, "frequency_hz"), number(row, "amplitude_nm")
        where = f"{place(row)}, {drive[0].normalize():f} Hz, {drive[1].normalize():f} N·m"
        choice = bases.get(setting_key(row), [])
        if choice and not math.isnan(float(row["reduction"])):
            best, slack = _nearest_reduction(row, choice)
            printed = number(row, "reduction")
            if abs(printed - best) > rounding(printed) + slack:
                text, expected = str(row["reduction"]), f"{best:.4f}"
                message = "reduction is not 1 - |tau|/|base| of this file's base row"
                found.append(Defect(table, where, text, expected, "percentage", message))
        key = (*setting_key(row), *drive)
        if key in first:
            one, two = number(first[key], "tau_nm"), number(row, "tau_nm")
            most = _most_apart(first[key], row, s)
            if abs(one - two) > Decimal(most) + rounding(one) + rounding(two):
                message = f"the same setting is there twice, at most {most:.3g} N·m apart"
                text = f"{row['tau_nm']} N·m"
                found.append(Defect(table, where, text, f"near {one}", "repeat", message))
        first.setdefault(key, row)
    return found


def check_fits(
    rows: Iterable[Row],
    table: str = "",
    bases: Mapping[tuple[str, int, str], float] | None = None,
    *,
    settings: TableCheckSettings | None = None,
) -> list[Defect]:
    """Line fits torque = intercept + slope × speed, as in table A.1.

    ``intercept_Nm`` (N·m) has the sign of its ``direction`` and is no larger than
    ``largest_fit`` times the breakaway torque; ``r2`` (no unit) is not near zero.

    Args:
        rows: the fits.
        table: name for the report.
        bases: mean abs(base torque) over the poses, N·m, by robot (our name), joint, direction.
        settings: constants of the rule; None for those of ``settings.toml``.
    """
    s = settings or measured_settings().table_checks
    rows = list(rows)
    found = []
    weak = []
    for row in rows:
        intercept, r2 = number(row, "intercept_Nm"), number(row, "r2")
        where, text = f"{place(row)}, intercept", str(row["intercept_Nm"])
        sign = 1 if row["direction"] == "+" else -1
        base = (bases or {}).get(
            (our_name(str(row["robot"])), int(number(row, "joint")), str(row["direction"]))
        )
        if intercept * sign <= 0:
            expected = "> 0" if sign > 0 else "< 0"
            message = "friction along the motion: sign against the direction"
            found.append(Defect(table, where, text, expected, "implausible", message))
        elif base is not None and abs(float(intercept)) > s.largest_fit * base:
            expected = f"at most {s.largest_fit:g} × {base:.4f}"
            message = "size: more than the joint needs to break away"
            found.append(Defect(table, where, text, expected, "implausible", message))
        if float(r2) < s.least_r2:
            message = "the line explains under a tenth of the variance"
            where, expected = f"{place(row)}, r2", f">= {s.least_r2:g}"
            weak.append(Defect(table, where, str(row["r2"]), expected, "implausible", message))
    if weak and len(weak) == len(rows) > 1:
        most = max(rows, key=lambda r: number(r, "r2"))["r2"]
        message = f"r2 is at most {most}: the lines explain under a tenth of the variance"
        return [*collapse(weak, len(rows), f"r2 >= {s.least_r2:g}", message), *found]
    return found + weak


def check_parameters(
    rows: Sequence[Row],
    table: str = "",
    *,
    total_kg: Mapping[str, float] | None = None,
    start_kg: Mapping[str, Mapping[int, float]] | None = None,
    settings: TableCheckSettings | None = None,
) -> list[Defect]:
    """Identified dynamic parameters, as in table 4.1: ``quantity``, ``value``.

    Each ``mass`` (kg) is positive and their sum between half of the arm's weight (the base does not
    move) and all of it; ``viscous`` (N·m·s/rad) is no larger than ``largest_viscous``. Signs of
    the friction terms are the regressor's convention and not judged.

    Args:
        rows: one parameter each; a mass printed twice counts once.
        table: name for the report.
        total_kg: weight of the arm, by robot (our name); not there, no sum is judged.
        start_kg: masses the fit was started with, by robot and joint; a mass that came back
            unchanged was not identified, which is a remark.
        settings: constants of the rule; None for those of ``settings.toml``.
    """
    s = settings or measured_settings().table_checks
    found = []
    masses: dict[tuple[str, int], Decimal] = {}
    for row in rows:
        at = our_name(str(row["robot"])), int(number(row, "joint"))
        where = f"{row['robot']} link {row['joint']}, {row['quantity']}"
        value, text = number(row, "value"), f"{row['value']} {row['unit']}"
        if row["quantity"] == "viscous" and abs(value) > s.largest_viscous:
            expected, message = f"within ±{s.largest_viscous:g}", "no drive could turn such a joint"
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


def _nearest_reduction(row: Row, bases: Sequence[Decimal]) -> tuple[Decimal, Decimal]:
    """Reduction by the base row that suits the printed one best, and its rounding."""
    tau, printed = number(row, "tau_nm"), number(row, "reduction")
    base = min(bases, key=lambda b: abs(1 - abs(tau / b) - printed))
    # The last term: reductions computed in double precision.
    slack = rounding(tau) / abs(base) + abs(tau) * rounding(base) / base**2 + Decimal("1e-12")
    return 1 - abs(tau / base), slack


def _most_apart(one: Row, two: Row, s: TableCheckSettings) -> float:
    """Difference two runs of one setting may have, N·m."""
    std = [float(r["std_nm"]) for r in (one, two)]
    if any(math.isnan(x) for x in std):
        return s.same_share * max(abs(float(r["tau_nm"])) for r in (one, two))
    return s.same_std * math.hypot(*std)
