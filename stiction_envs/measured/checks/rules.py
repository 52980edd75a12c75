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
from stiction_envs.measured.thesis_robots import our_name

Row = Mapping[str, Any]
Bases = Mapping[tuple[str, int, str, str], str]
"""Printed base torque, N·m, by :func:`setting_key`."""
SAME_STD = 5.0
"""Combined standard deviations by which two runs of one SJE setting contradict [-]."""
SAME_SHARE = 0.25
"""Share of the torque that takes their place where no deviation is known [-]: five times the 4.7
points by which the thesis's own runs repeat."""
REPEAT_SIGMAS = 10.0
"""Robust standard deviations by which a repetition contradicts [-].

The spread differs between joints (thesis: 5 points at joints 1–4, 1 at joints 5–7), so that the
pooled median deviation is half the standard deviation: 10 robust ones are 5 ordinary ones, 25
points in the thesis. Its worst credible pair is 19 points apart, its one bad reading 96."""
LEAST_SPREAD = 1.0
"""Repetitions closer than this times `REPEAT_SIGMAS` never contradict [percentage points]."""
LEAST_REPEATS = 5
"""Repeated settings from which a spread can be told."""


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


def check_measurements(rows: Iterable[Row]) -> list[Defect]:
    """Repetitions of one setting agree within `REPEAT_SIGMAS` of all repetitions' spread.

    Rows have ``table``, the key columns, ``frequency_Hz``, ``scale``, ``tau_sje_Nm`` (N·m) and
    ``change_pct``. The spread is 1.4826 × the median distance of a reading from the others of its
    setting. Of a pair that contradicts, the reading further from what the same joint, pose and
    direction gave at its other settings is the bad one. Fewer than
    `LEAST_REPEATS` repeated settings tell nothing.
    """
    rows = list(rows)
    repeated = [
        g
        for g in _grouped(
            rows, lambda r: (setting_key(r), number(r, "frequency_Hz"), number(r, "scale"))
        )
        if len(g) > 1
    ]
    if len(repeated) < LEAST_REPEATS:
        return []
    gaps = [abs(gap) for group in repeated for gap in _gaps(group)]
    most = REPEAT_SIGMAS * max(LEAST_SPREAD, 1.4826 * median(gaps))
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


def check_sje(rows: Iterable[Row], table: str = "") -> list[Defect]:
    """A table in the form of :func:`~stiction_envs.measured.read_sje`.

    ``tau_nm`` (N·m) has the sign of ``direction``; ``reduction`` is 1 − abs(tau_nm)/abs(base) with
    a base row (no dither) of the same robot, joint, pose and direction, up to the printed digits;
    rows of the same setting do not contradict. ``nan`` and rows without a base row pass.
    """
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
            most = _most_apart(first[key], row)
            if abs(one - two) > Decimal(most) + rounding(one) + rounding(two):
                message = f"the same setting is there twice, at most {most:.3g} N·m apart"
                text = f"{row['tau_nm']} N·m"
                found.append(Defect(table, where, text, f"near {one}", "repeat", message))
        first.setdefault(key, row)
    return found


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


def _nearest_reduction(row: Row, bases: Sequence[Decimal]) -> tuple[Decimal, Decimal]:
    """Reduction by the base row that suits the printed one best, and its rounding."""
    tau, printed = number(row, "tau_nm"), number(row, "reduction")
    base = min(bases, key=lambda b: abs(1 - abs(tau / b) - printed))
    # The last term: reductions computed in double precision.
    slack = rounding(tau) / abs(base) + abs(tau) * rounding(base) / base**2 + Decimal("1e-12")
    return 1 - abs(tau / base), slack


def _most_apart(one: Row, two: Row) -> float:
    """Difference two runs of one setting may have, N·m."""
    std = [float(r["std_nm"]) for r in (one, two)]
    if any(math.isnan(x) for x in std):
        return SAME_SHARE * max(abs(float(r["tau_nm"])) for r in (one, two))
    return SAME_STD * math.hypot(*std)
