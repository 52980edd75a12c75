"""Rules a printed torque table keeps, one function each, on plain rows of strings.

A row is a mapping from column name to the text *as printed*: its digits tell how far the number
was rounded, half a unit in the last place. Column names and units are those of the thesis's
CSVs (``thesis/README.md``): torques ``*_Nm`` in N·m, ``frequency_Hz`` in Hz, ``change_pct`` in
percent. Each rule returns the list of :class:`Defect` it finds, and an empty list if all is well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from statistics import median
from typing import Any

from stiction_envs.errors import StictionError
from stiction_envs.measured.settings import TableCheckSettings, measured_settings
from stiction_envs.measured.thesis_robots import our_name

Row = Mapping[str, Any]
Bases = Mapping[tuple[str, int, str, str], str]
"""Printed base torque, N·m, by :func:`setting_key`."""

_LENGTHS = ("m", "cm", "mm", "m·samples", "mm·samples", "m·s", "mm·s")
_ANGLES = ("rad", "deg", "°", "rad·samples", "deg·samples", "rad·s", "deg·s")
AXIS_UNITS = dict.fromkeys("xyz", _LENGTHS) | dict.fromkeys(("roll", "pitch", "yaw"), _ANGLES)
"""Units an error along or about an axis can have, or its sum over samples or time."""


@dataclass(frozen=True)
class Defect:
    """One thing that is wrong in a table, or worth a remark."""

    table: str
    """Number of the thesis table, or path of the file."""
    where: str
    """Row, and column if the row does not tell it; ``all`` if every row shares the defect."""
    printed: str
    """As it is in the table."""
    expected: str
    """What should be there, or the range that can be."""
    kind: str
    """``percentage``, ``amplitude``, ``scale``, ``final``, ``repeat``, ``difference``, ``unit``,
    ``sign``, ``implausible``, or ``remark``: true, but not wrong (rounding, declared exceptions,
    errors that grew)."""
    message: str
    """Why, in one line."""

    def __str__(self) -> str:
        return (
            f"{self.table}: {self.where}: {self.kind}: {self.printed}, expected {self.expected}: "
            f"{self.message}"
        )


def setting_key(row: Row) -> tuple[str, int, str, str]:
    """Robot by our name, joint from 1, pose and direction of a row."""
    joint = int(number(row, "joint"))
    return our_name(str(row["robot"])), joint, str(row["load"]), str(row["direction"])


def place(row: Row) -> str:
    """Where a row is, such as ``panda joint 5, no_load +``."""
    text = f"{row['robot']} joint {row['joint']}"
    if "load" in row:
        text += f", {row['load']}"
    return f"{text} {row['direction']}" if "direction" in row else text


def number(row: Row, column: str) -> Decimal:
    """A cell as an exact decimal number."""
    raw = str(row.get(column, "")).strip()
    try:
        value = Decimal("" if "_" in raw else raw)
    except InvalidOperation:
        value = Decimal("nan")
    if not value.is_finite():
        raise StictionError(f"{column} is {raw!r}: expected finite numbers as text")
    return value


def rounding(value: Decimal) -> Decimal:
    """Half a unit in the last printed place."""
    return Decimal((0, (5,), int(value.as_tuple().exponent) - 1))


def check_percentages(
    rows: Iterable[Row], table: str = "", bases: Bases | None = None
) -> list[Defect]:
    """``change_pct`` is 100 (|τ_sje|/|τ_base| − 1), as far as the printed digits tell.

    Args:
        rows: with ``tau_sje_Nm``, ``change_pct`` and ``tau_base_Nm`` or an entry in ``bases``.
        table: name for the report.
        bases: base torques, N·m, for tables that do not print them; a row whose base is not
            known is passed over.
    """
    found = []
    for row in rows:
        raw = row.get("tau_base_Nm", (bases or {}).get(setting_key(row)))
        if raw is None:
            continue
        base, tau = (number({"tau_base_Nm": raw}, "tau_base_Nm"), number(row, "tau_sje_Nm"))
        printed = number(row, "change_pct")
        if base == 0:
            found.append(Defect(table, place(row), str(raw), "not 0", "sign", "base torque is 0"))
            continue
        percent = 100 * (abs(tau / base) - 1)
        slack = rounding(tau) / abs(base) + abs(tau) * rounding(base) / base**2
        # First order in the rounding; the hundredth covers the second.
        if abs(percent - printed) > rounding(printed) + 101 * slack:
            message = f"|{tau}| against |{base}| N·m is {percent:+.2f} %"
            found.append(
                Defect(
                    table,
                    _with_setting(row),
                    f"{row['change_pct']} %",
                    f"{percent:+.2f} %",
                    "percentage",
                    message,
                )
            )
    return found


def check_signs(rows: Iterable[Row], columns: Sequence[str], table: str = "") -> list[Defect]:
    """Torques in ``columns``, N·m, have the sign of the row's ``direction``."""
    found = []
    for row in rows:
        sign = 1 if row["direction"] == "+" else -1
        for column in columns:
            if number(row, column) * sign <= 0:
                expected = "> 0" if sign > 0 else "< 0"
                message = f"{column} against the direction of its ramp"
                where = _with_setting(row)
                found.append(Defect(table, where, str(row[column]), expected, "sign", message))
    return found


def check_amplitudes(rows: Iterable[Row], table: str = "") -> list[Defect]:
    """Intermediate amplitude = base × scale; final = the joint's largest |intermediate|.

    Rows as in table 4.9: ``tau_base_Nm``, ``tau_intermediate_Nm``, ``tau_final_Nm`` in N·m,
    ``scale``, ``final_set_by_hand`` (``yes`` turns another final into a remark). Where most rows of
    a joint follow one other scale, the scale is wrong and not they. A final is compared with the
    corrected intermediates, so that one misprint is one defect.
    """
    found = []
    for group in _grouped(rows, lambda r: (r["robot"], r["joint"])):
        joint = f"{group[0]['robot']} joint {group[0]['joint']}"
        scale = joint_scale(group)
        for printed in dict.fromkeys(str(r["scale"]) for r in group):
            if Decimal(printed) != scale:
                message = f"the intermediate amplitudes are {scale} × base"
                where = f"{joint}, scale"
                found.append(Defect(table, where, printed, str(scale), "scale", message))
        right = []
        for row in group:
            base, middle = number(row, "tau_base_Nm"), number(row, "tau_intermediate_Nm")
            if _follows(row, scale):
                right.append(abs(middle))
                continue
            right.append(abs(base * scale))
            where = f"{place(row)}, intermediate"
            wanted = f"{base * scale:.4f}"
            message = f"{base} N·m × {scale}"
            found.append(Defect(table, where, str(middle), wanted, "amplitude", message))
        largest = max(right)
        source = f"largest intermediate is {largest.normalize():f} N·m"
        for printed, hand in dict.fromkeys(
            (str(r["tau_final_Nm"]), str(r.get("final_set_by_hand", "no"))) for r in group
        ):
            final = Decimal(printed)
            if abs(abs(final) - largest) > max(rounding(final), rounding(largest)):
                kind, note = (
                    ("remark", "; set by hand, declared") if hand == "yes" else ("final", "")
                )
                where, wanted = f"{joint}, final", f"{largest.normalize():f}"
                found.append(Defect(table, where, printed, wanted, kind, source + note))
    return found


def joint_scale(group: Sequence[Row]) -> Decimal:
    """The scale that the rows of one joint follow: the printed one, or what most of them say."""
    printed = number(group[0], "scale")
    votes = [
        round(abs(number(r, "tau_intermediate_Nm") / number(r, "tau_base_Nm")), 2)
        for r in group
        if number(r, "tau_base_Nm") != 0
    ]
    # Two decimals: the resolution of any sensible scale, coarser than the torques' rounding.
    votes = [v.quantize(Decimal("0.1")) if v == round(v, 1) else v for v in votes]
    best = max(dict.fromkeys([printed, *votes]), key=lambda s: sum(_follows(r, s) for r in group))
    most = sum(_follows(r, best) for r in group)
    return best if 2 * most > len(group) and most > 1 else printed


def check_repeats(
    readings: Iterable[tuple[str, str, str]], *, enough_digits: int | None = None
) -> list[Defect]:
    """One quantity printed several times is the same up to the rounding of the shorter number.

    Two readings contradict when they differ by more than half a unit in the last place of the one
    with fewer decimals. A contradiction is reported at the reading most others contradict, at the
    later one of two; a mere difference in digits once per quantity, as a remark.

    Args:
        readings: (table, quantity, printed number).
        enough_digits: no remark where the shorter number has this many significant digits.
    """
    found = []
    for group in _grouped(readings, lambda x: x[1]):
        values = [number({what: raw}, what) for _, what, raw in group]
        against = [sum(not _agree(a, b) for b in values) for a in values]
        if any(against):
            bad = [i for i, n in enumerate(against) if 2 * n >= len(group)]
            if len({(group[i][0], values[i]) for i in bad}) != 1:
                bad = [max(range(len(group)), key=lambda i: (against[i], i))]
            table, what, raw = group[bad[0]]
            others = [x for x, v in zip(group, values, strict=True) if v != values[bad[0]]]
            shown = ", ".join(dict.fromkeys(f"{r} in {t}" for t, _, r in others))
            expected = " or ".join(dict.fromkeys(r for _, _, r in others))
            message = f"the same quantity is {shown}"
            found.append(Defect(table, what, raw, expected, "repeat", message))
        elif len(set(values)) > 1:
            short = min(range(len(group)), key=lambda i: _decimals(values[i]))
            if enough_digits and len(values[short].as_tuple().digits) >= enough_digits:
                continue
            long = max(range(len(group)), key=lambda i: _decimals(values[i]))
            table, what, raw = group[short]
            message = f"rounding only: {group[long][2]} in {group[long][0]}"
            found.append(Defect(table, what, raw, group[long][2], "remark", message))
    return found


def check_measurements(
    rows: Iterable[Row], *, settings: TableCheckSettings | None = None
) -> list[Defect]:
    """Repetitions of one setting agree within ``repeat_sigmas`` of all repetitions' spread.

    Rows have ``table``, the key columns, ``frequency_Hz``, ``scale``, ``tau_sje_Nm`` (N·m) and
    ``change_pct``. The spread is 1.4826 × the median distance of a reading from the others of its
    setting. Of a pair that contradicts, the reading further from what the same joint, pose and
    direction gave at its other settings is the bad one. With fewer than five repeated settings
    nothing can be told.
    """
    s = settings or measured_settings().table_checks
    rows = list(rows)
    repeated = [
        g
        for g in _grouped(
            rows, lambda r: (setting_key(r), number(r, "frequency_Hz"), number(r, "scale"))
        )
        if len(g) > 1
    ]
    if len(repeated) < s.least_repeats:
        return []
    gaps = [abs(gap) for group in repeated for gap in _gaps(group)]
    most = s.repeat_sigmas * max(s.least_spread, 1.4826 * median(gaps))
    found = []
    for group in repeated:
        usual = median(
            float(number(r, "change_pct")) for r in rows if setting_key(r) == setting_key(group[0])
        )
        while len(group) > 1 and max(abs(gap) for gap in _gaps(group)) > most:
            bad = max(group, key=lambda r: abs(float(number(r, "change_pct")) - usual))
            group = [r for r in group if r is not bad]
            other = group[0]
            message = (
                f"not credible: repeated in {other['table']} with {other['tau_sje_Nm']} N·m; "
                f"repetitions differ by up to {most:.0f} points"
            )
            printed = f"{bad['tau_sje_Nm']} N·m, {bad['change_pct']} %"
            wanted = f"near {other['change_pct']} %"
            where = f"{place(bad)}, {number(bad, 'frequency_Hz').normalize():f} Hz"
            found.append(Defect(str(bad["table"]), where, printed, wanted, "repeat", message))
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
        units = AXIS_UNITS.get(str(row["axis"]))
        if units is None:
            names = ", ".join(AXIS_UNITS)
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


def _grouped(items: Iterable[Any], key: Callable[[Any], Any]) -> list[list[Any]]:
    groups: dict[Any, list[Any]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return list(groups.values())


def _with_setting(row: Row) -> str:
    """Place of a row with whatever tells it from others of the same joint, pose and direction."""
    text = place(row)
    if "frequency_Hz" in row and "tau_intermediate_Nm" not in row:
        text += f", {row['frequency_Hz']} Hz"
    return f"{text}, {row['amplitude_set']}" if "amplitude_set" in row else text


def _follows(row: Row, scale: Decimal) -> bool:
    base, middle = number(row, "tau_base_Nm"), number(row, "tau_intermediate_Nm")
    slack = rounding(middle) + scale * rounding(base)
    return abs(abs(middle) - abs(base) * scale) <= slack


def _decimals(value: Decimal) -> int:
    return -int(value.as_tuple().exponent)


def _agree(a: Decimal, b: Decimal) -> bool:
    return a == b or (_decimals(a) != _decimals(b) and abs(a - b) <= max(rounding(a), rounding(b)))


def _gaps(group: Sequence[Row]) -> list[float]:
    """Distance of each reading's percentage from the median of the others, points."""
    values = [float(number(r, "change_pct")) for r in group]
    gaps = [v - median(values[:i] + values[i + 1 :]) for i, v in enumerate(values)]
    return [g for g in gaps if math.isfinite(g)]
