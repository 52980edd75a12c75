"""Defects of a torque table: what contradicts itself, as far as the printed digits show.

A number's digits say how far it was rounded: half a unit in the last place.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal

from stiction_envs.measured.csv_text import Line, header_of, read_lines
from stiction_envs.measured.tables import (
    BASE_COLUMNS,
    DIRECTIONS,
    LOADS,
    SJE_COLUMNS,
    parse_sje,
    read_amplitudes,
)
from stiction_envs.robots.tables import Limits

SAME_STD = 5.0
"""Two runs of one setting contradict if they differ by more combined standard deviations
[-]; assumed."""
SAME_SHARE = 0.25
"""Share of the torque, where no deviation is known [-]. Source: five times the 4.7
points by which the thesis's own runs repeat."""
ANY_JOINTS = 99  # joints of an amplitude table's robot where it is not known


@dataclass(frozen=True)
class Defect:
    """One thing that is wrong in a table."""

    where: str
    """Row."""
    kind: str
    """``sign``, ``percentage`` or ``repeat``."""
    message: str
    """Value that is there, value that is expected, and the reason, in one line."""


def check_table(path: str | os.PathLike[str], limits: Limits | None = None) -> Iterator[Defect]:
    """Yield the defects of an SJE table, a table of base torques or an amplitude table.

    ``limits`` of the robot bound amplitudes; None where the robot is not known.

    Raises:
        StictionError: the file cannot be read as such a table.
    """
    header = header_of(path)
    if "tau_base_Nm" in header:
        for line in read_lines(path, BASE_COLUMNS):
            joint, load = line.whole("joint", 1), line.name("load", LOADS)
            direction, tau = line.name("direction", DIRECTIONS), line.number("tau_base_Nm")
            yield from _check_sign(f"{line.text('robot')} joint {joint}, {load}", direction, tau)
    elif "tau_nm" in header or "robot" in header:
        yield from _check_sje(read_lines(path, SJE_COLUMNS))
    elif limits is None:
        read_amplitudes(path, n_joints=ANY_JOINTS)
    else:
        read_amplitudes(path, n_joints=len(limits.torque), torque_limit=limits.torque)


def _check_sign(where: str, direction: str, tau: float) -> Iterator[Defect]:
    sign, expected = (1, "> 0") if direction == "+" else (-1, "< 0")
    if tau * sign <= 0:
        message = f"{tau:g}, expected {expected}: torque against the direction of its ramp"
        yield Defect(f"{where} {direction}", "sign", message)


def _check_sje(lines: list[Line]) -> Iterator[Defect]:
    """Yield wrong signs, reductions that are not 1 − |tau|/|base|, and contradicting repetitions.

    NaN and rows without a base row of the same robot, joint, pose and direction pass.
    """
    rows = parse_sje(lines)
    tau = [Decimal(line.fields["tau_nm"]) for line in lines]
    keys = [(row.robot, row.joint, row.load, row.direction) for row in rows]
    for row in rows:
        place = f"{row.robot} joint {row.joint}, {row.load}"
        yield from _check_sign(place, row.direction, row.tau_nm)
    bases: dict[tuple[object, ...], list[Decimal]] = {}
    for row, key, x in zip(rows, keys, tau, strict=True):
        if row.is_base and x:
            bases.setdefault(key, []).append(x)
    first: dict[tuple[object, ...], int] = {}
    for k, (row, key) in enumerate(zip(rows, keys, strict=True)):
        where = f"{row.robot} joint {row.joint}, {row.load} {row.direction}, "
        where += f"{row.frequency_hz:g} Hz, {row.amplitude_nm:g} N·m"
        if key in bases and not math.isnan(row.reduction):
            printed = Decimal(lines[k].fields["reduction"])
            # of several base rows the one that suits the printed number best
            base = min(bases[key], key=lambda b: abs(1 - abs(tau[k] / b) - printed))
            best = 1 - abs(tau[k] / base)
            slack = _rounding(tau[k]) / abs(base) + abs(tau[k]) * _rounding(base) / base**2
            # The last term: reductions computed in double precision.
            if abs(printed - best) > _rounding(printed) + slack + Decimal("1e-12"):
                message = f"{printed}, expected {best:.4f}: 1 - |tau|/|base| of the base row"
                yield Defect(where, "percentage", message)
        before = first.setdefault((*key, row.frequency_hz, row.amplitude_nm), k)
        std = SAME_STD * math.hypot(rows[before].std_nm, row.std_nm)
        share = SAME_SHARE * max(abs(rows[before].tau_nm), abs(row.tau_nm))
        most = Decimal(share if math.isnan(std) else std)
        if abs(tau[before] - tau[k]) > most + _rounding(tau[before]) + _rounding(tau[k]):
            message = f"{tau[k]} N·m, expected near {tau[before]}: the same setting is there twice"
            yield Defect(where, "repeat", f"{message}, at most {most:.3g} N·m apart")


def _rounding(value: Decimal) -> Decimal:
    """Half a unit in the last printed place."""
    return Decimal((0, (5,), int(value.as_tuple().exponent) - 1))
