"""Rules that a printed torque table keeps, on plain rows of strings.

A row is a mapping from column name to the text *as printed*. Its digits say how far the number
was rounded: half a unit in the last place. Column names and units are those of the thesis's
CSVs (``thesis/README.md``): torques ``*_Nm`` in N·m, ``frequency_Hz`` in Hz, ``change_pct`` in
percent. Each rule yields the defects that it finds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from statistics import median
from typing import TypeVar

from stiction_envs.errors import StictionError
from stiction_envs.measured.thesis_robots import our_name

Item = TypeVar("Item")
Key = TypeVar("Key")
Row = Mapping[str, str]
Setting = tuple[str, int, str, str]
"""Robot by our name, joint from 1, pose and direction."""
Bases = Mapping[Setting, str]
"""Printed base torques [N·m]."""
SIGNED = ("tau_base_Nm", "tau_intermediate_Nm", "tau_sje_Nm")
"""Columns of torques that have the sign of the row's direction."""
SAME_STD = 5.0
"""Two runs of one SJE setting contradict if they differ by more combined standard deviations
[-]; assumed."""
SAME_SHARE = 0.25
"""The same as a share of the torque, where no deviation is known [-]. Source: five times the 4.7
points by which the thesis's own runs repeat."""
REPEAT_SIGMAS = 10.0
"""A repetition contradicts if it is off by more robust standard deviations [-].

Source: the thesis. Its spread differs between joints (5 points at joints 1–4, 1 at joints 5–7), so
that the pooled median deviation is half the standard deviation: 10 robust ones are 5 ordinary ones,
25 points. Its worst credible pair is 19 points apart, its one bad reading 96."""
LEAST_SPREAD = 1.0
"""Least robust standard deviation of repetitions [percentage points]; assumed."""
LEAST_REPEATS = 5
"""Fewest repeated settings that show a spread; assumed."""


@dataclass(frozen=True)
class Defect:
    """One thing that is wrong in a table, or worth a remark."""

    where: str
    """Row, and column if the row does not identify it; ``all`` if every row shares the defect."""
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
    table: str = ""
    """Number of the thesis table, or path of the file."""

    def __str__(self) -> str:
        return (
            f"{self.table}: {self.where}: {self.kind}: {self.printed}, expected {self.expected}: "
            f"{self.message}"
        )


def setting_key(row: Row) -> Setting:
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


def sign_of(row: Row) -> tuple[int, str]:
    """Sign of the row's direction, and what a torque along it is."""
    return (1, "> 0") if row["direction"] == "+" else (-1, "< 0")


def grouped(items: Iterable[Item], key: Callable[[Item], Key]) -> dict[Key, list[Item]]:
    """Items by their key, in the order in which the keys first occur."""
    groups: dict[Key, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def check_percentages(rows: Iterable[Row], bases: Bases | None = None) -> Iterator[Defect]:
    """``change_pct`` is 100 (|τ_sje|/|τ_base| − 1), as far as the printed digits show.

    Args:
        rows: with ``tau_sje_Nm``, ``change_pct`` and ``tau_base_Nm`` or an entry in ``bases``.
        bases: for tables that print no base torque; a row without one passes.
    """
    for row in rows:
        raw = row.get("tau_base_Nm", (bases or {}).get(setting_key(row)))
        if raw is None:
            continue
        base, tau = number({"tau_base_Nm": raw}, "tau_base_Nm"), number(row, "tau_sje_Nm")
        if base == 0:
            yield Defect(place(row), str(raw), "not 0", "sign", "base torque is 0")
            continue
        printed, percent = number(row, "change_pct"), 100 * (abs(tau / base) - 1)
        # First order in the rounding; the hundredth covers the second.
        if abs(percent - printed) > rounding(printed) + 101 * _ratio_rounding(tau, base):
            text, expected = f"{row['change_pct']} %", f"{percent:+.2f} %"
            message = f"|{tau}| against |{base}| N·m is {expected}"
            yield Defect(_with_setting(row), text, expected, "percentage", message)


def check_signs(rows: Iterable[Row], columns: Sequence[str] = SIGNED) -> Iterator[Defect]:
    """Torques have the sign of the row's ``direction``."""
    for row in rows:
        sign, expected = sign_of(row)
        for column in columns:
            if column in row and number(row, column) * sign <= 0:
                message = f"{column} against the direction of its ramp"
                yield Defect(_with_setting(row), str(row[column]), expected, "sign", message)


def check_amplitudes(rows: Iterable[Row]) -> Iterator[Defect]:
    """Intermediate amplitude = base × scale; final = the joint's largest |intermediate|.

    Rows as in table 4.9: ``tau_base_Nm``, ``tau_intermediate_Nm``, ``tau_final_Nm`` in N·m,
    ``scale``, ``final_set_by_hand`` (``yes`` turns another final into a remark). Where most rows of
    a joint follow one other scale, the scale is wrong and not they. A final is compared with the
    corrected intermediates, so that one misprint is one defect.
    """
    for group in grouped(rows, lambda r: (r["robot"], r["joint"])).values():
        joint = f"{group[0]['robot']} joint {group[0]['joint']}"
        scale = joint_scale(group)
        for printed in dict.fromkeys(str(r["scale"]) for r in group):
            if Decimal(printed) != scale:
                message = f"the intermediate amplitudes are {scale} × base"
                yield Defect(f"{joint}, scale", printed, str(scale), "scale", message)
        right = []
        for row in group:
            base, middle = number(row, "tau_base_Nm"), number(row, "tau_intermediate_Nm")
            if _follows(row, scale):
                right.append(abs(middle))
                continue
            right.append(abs(base * scale))
            where, expected = f"{place(row)}, intermediate", f"{base * scale:.4f}"
            yield Defect(where, str(middle), expected, "amplitude", f"{base} N·m × {scale}")
        largest = max(right)
        expected = f"{largest.normalize():f}"
        for printed, by_hand in dict.fromkeys(
            (str(r["tau_final_Nm"]), r.get("final_set_by_hand") == "yes") for r in group
        ):
            final = Decimal(printed)
            if abs(abs(final) - largest) > max(rounding(final), rounding(largest)):
                message = f"largest intermediate is {expected} N·m"
                message += "; set by hand, declared" if by_hand else ""
                kind = "remark" if by_hand else "final"
                yield Defect(f"{joint}, final", printed, expected, kind, message)


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
) -> Iterator[Defect]:
    """One quantity printed several times is the same up to the rounding of the shorter number.

    Two readings contradict when they differ by more than half a unit in the last place of the one
    with fewer decimals. A contradiction is reported at the reading most others contradict, at the
    later one of two; a mere difference in digits once per quantity, as a remark.

    Args:
        readings: (table, quantity, printed number).
        enough_digits: no remark where the shorter number has this many significant digits.
    """
    for what, group in grouped(readings, lambda x: x[1]).items():
        values = [number({what: raw}, what) for _, _, raw in group]
        against = [sum(not _agree(a, b) for b in values) for a in values]
        if any(against):
            bad = [i for i, n in enumerate(against) if 2 * n >= len(group)]
            if len({(group[i][0], values[i]) for i in bad}) != 1:
                bad = [max(range(len(group)), key=lambda i: (against[i], i))]
            table, _, raw = group[bad[0]]
            others = [x for x, v in zip(group, values, strict=True) if v != values[bad[0]]]
            expected = " or ".join(dict.fromkeys(r for _, _, r in others))
            shown = ", ".join(dict.fromkeys(f"{r} in {t}" for t, _, r in others))
            yield Defect(what, raw, expected, "repeat", f"the same quantity is {shown}", table)
        elif len(set(values)) > 1:
            short, long = (
                pick(range(len(group)), key=lambda i: _decimals(values[i])) for pick in (min, max)
            )
            if not enough_digits or len(values[short].as_tuple().digits) < enough_digits:
                (table, _, raw), (other, _, expected) = group[short], group[long]
                message = f"rounding only: {expected} in {other}"
                yield Defect(what, raw, expected, "remark", message, table)


def check_measurements(rows: Sequence[Row]) -> Iterator[Defect]:
    """Repetitions of one setting agree within `REPEAT_SIGMAS` of all repetitions' spread.

    Rows have ``table``, the key columns, ``frequency_Hz``, ``scale``, ``tau_sje_Nm`` (N·m) and
    ``change_pct``. The spread is 1.4826 × the median distance of a reading from the others of its
    setting. Of a pair that contradicts, the reading further from what the same joint, pose and
    direction gave at its other settings is the bad one. Fewer than
    `LEAST_REPEATS` repeated settings show no spread.
    """
    by_key = grouped(rows, setting_key)
    same = grouped(rows, lambda r: (setting_key(r), number(r, "frequency_Hz"), number(r, "scale")))
    repeated = [(key, group) for (key, *_), group in same.items() if len(group) > 1]
    if len(repeated) < LEAST_REPEATS:
        return
    gaps = [abs(gap) for _, group in repeated for gap in _gaps(group)]
    most = REPEAT_SIGMAS * max(LEAST_SPREAD, 1.4826 * median(gaps))
    for key, group in repeated:
        usual = median(_percent(r) for r in by_key[key])
        while len(group) > 1 and max(abs(gap) for gap in _gaps(group)) > most:
            bad = max(group, key=lambda r: abs(_percent(r) - usual))
            group = [r for r in group if r is not bad]
            other = group[0]
            yield Defect(
                f"{place(bad)}, {number(bad, 'frequency_Hz').normalize():f} Hz",
                f"{bad['tau_sje_Nm']} N·m, {bad['change_pct']} %",
                f"near {other['change_pct']} %",
                "repeat",
                f"not credible: repeated in {other['table']} with {other['tau_sje_Nm']} N·m; "
                f"repetitions differ by up to {most:.0f} points",
                str(bad["table"]),
            )


def check_sje(rows: Sequence[Row]) -> Iterator[Defect]:
    """A table in the form of :func:`~stiction_envs.measured.read_sje`.

    ``tau_nm`` (N·m) has the sign of ``direction``; ``reduction`` is 1 − abs(tau_nm)/abs(base) with
    a base row (no dither) of the same robot, joint, pose and direction, up to the printed digits;
    rows of the same setting do not contradict. ``nan`` and rows without a base row pass.
    """
    yield from check_signs(rows, ["tau_nm"])
    bases: dict[Setting, list[Decimal]] = {}
    for row in rows:
        tau = number(row, "tau_nm")
        if number(row, "frequency_hz") == number(row, "amplitude_nm") == 0 and tau != 0:
            bases.setdefault(setting_key(row), []).append(tau)
    first: dict[tuple[object, ...], Row] = {}
    for row in rows:
        key, tau = setting_key(row), number(row, "tau_nm")
        drive = number(row, "frequency_hz"), number(row, "amplitude_nm")
        where = f"{place(row)}, {drive[0].normalize():f} Hz, {drive[1].normalize():f} N·m"
        if key in bases and not math.isnan(float(row["reduction"])):
            printed = number(row, "reduction")
            # of several base rows the one that suits the printed number best
            base = min(bases[key], key=lambda b: abs(1 - abs(tau / b) - printed))
            best = 1 - abs(tau / base)
            # The last term: reductions computed in double precision.
            slack = rounding(printed) + _ratio_rounding(tau, base) + Decimal("1e-12")
            if abs(printed - best) > slack:
                message = "reduction is not 1 - |tau|/|base| of this file's base row"
                text, expected = str(row["reduction"]), f"{best:.4f}"
                yield Defect(where, text, expected, "percentage", message)
        before = first.setdefault((key, *drive), row)
        if before is not row:
            one, most = number(before, "tau_nm"), _most_apart(before, row)
            if abs(one - tau) > Decimal(most) + rounding(one) + rounding(tau):
                message = f"the same setting is there twice, at most {most:.3g} N·m apart"
                yield Defect(where, f"{row['tau_nm']} N·m", f"near {one}", "repeat", message)


def _with_setting(row: Row) -> str:
    """Place of a row, and what differs from others of the same joint, pose and direction."""
    text = place(row)
    if "frequency_Hz" in row and "tau_intermediate_Nm" not in row:
        text += f", {row['frequency_Hz']} Hz"
    return f"{text}, {row['amplitude_set']}" if "amplitude_set" in row else text


def _ratio_rounding(tau: Decimal, base: Decimal) -> Decimal:
    """How far the rounding of two torques can move their ratio, to first order."""
    return rounding(tau) / abs(base) + abs(tau) * rounding(base) / base**2


def _follows(row: Row, scale: Decimal) -> bool:
    base, middle = number(row, "tau_base_Nm"), number(row, "tau_intermediate_Nm")
    slack = rounding(middle) + scale * rounding(base)
    return abs(abs(middle) - abs(base) * scale) <= slack


def _decimals(value: Decimal) -> int:
    return -int(value.as_tuple().exponent)


def _agree(a: Decimal, b: Decimal) -> bool:
    return a == b or (_decimals(a) != _decimals(b) and abs(a - b) <= max(rounding(a), rounding(b)))


def _percent(row: Row) -> float:
    return float(number(row, "change_pct"))


def _gaps(group: Sequence[Row]) -> list[float]:
    """Distance of each reading's percentage from the median of the others [percentage points]."""
    values = [_percent(r) for r in group]
    return [v - median(values[:i] + values[i + 1 :]) for i, v in enumerate(values)]


def _most_apart(one: Row, two: Row) -> float:
    """Difference two runs of one setting may have [N·m]."""
    std = [float(r["std_nm"]) for r in (one, two)]
    if any(math.isnan(x) for x in std):
        return SAME_SHARE * max(abs(float(r["tau_nm"])) for r in (one, two))
    return SAME_STD * math.hypot(*std)
