"""Texts and tables of a report, of any kind of data."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.gap.causes import parameter_units
from stiction_envs.gap.judge.judgement import Estimate, Judgement, NamedCause, NotShown
from stiction_envs.reporting.markdown import joints, number, percent, short, span, table_text

UNITS = {
    "nm": "N·m",
    "nms": "N·m·s",
    "nm_per_s": "N·m/s",
    "nm_per_rad": "N·m/rad",
    "rad_s": "rad/s",
    "rad": "rad",
    "s": "s",
    "kg": "kg",
    "m": "m",
    "kgm2": "kg·m²",
    "hz": "Hz",
}
"""Unit by the end of a parameter's name."""
LISTED = 4
"""Most numbers of one parameter that the table of causes shows [-]; assumed."""
SHARES = "named", "links", "set_up", "left"


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Error of each joint under both models; (n,) each, in one unit."""

    what: str
    """Quantity that is averaged, and how."""
    unit: str
    joints: tuple[int, ...]
    """From 1."""
    nominal: Array
    extended: Array
    noise: Array
    """Noise floor; NaN where unknown."""
    check: tuple[Array, Array] | None = None
    """Nominal and extended error on logs that took no part."""

    def table(self) -> str:
        """Return the table of the report."""
        columns = {"nominal": self.nominal, "extended": self.extended, "noise floor": self.noise}
        if self.check is not None:
            columns |= {"check, nominal": self.check[0], "check, extended": self.check[1]}
        change = 100 * (self.extended / np.maximum(self.nominal, 1e-300) - 1)
        rows = [
            [f"joint {j}", percent(change[k], 0), *(short(x[k]) for x in columns.values())]
            for k, j in enumerate(self.joints)
        ]
        return table_text(["", "change", *(f"{name} [{self.unit}]" for name in columns)], rows)


def where(numbers: Sequence[int]) -> str:
    """Return ``joint 3``, ``joints 1 and 2``, ``joints 1 to 7`` or ``whole arm``."""
    if len(numbers) > 2 and list(numbers) == list(range(numbers[0], numbers[-1] + 1)):
        return f"joints {numbers[0]} to {numbers[-1]}"
    return joints(numbers) if numbers else "whole arm"


def shares(d: Judgement, errors: Errors) -> str:
    """Return who takes how much off the nominal error, a sentence."""
    before, after = (short(x.mean()) for x in (errors.nominal, errors.extended))
    text = (
        f"The extended model takes {number(d.gain_percent, 0)} % off the held-out error, from "
        f"{before} to {after} {errors.unit} in the mean of the joints"
    )
    if not d.shares_percent:
        return f"{text}."
    named, links, set_up, left = (number(d.shares_percent[k], 0) for k in SHARES)
    return (
        f"{text}: the named causes {named} %, errors of links {links} %, the set-up {set_up} %; "
        f"{left} % is left."
    )


def cause_table(causes: Sequence[NamedCause]) -> str:
    """Return the report's first table."""
    rows = []
    for c in causes:
        (best, *_) = rivals(c) or ["–" if np.isnan(c.nats) else "none"]
        rows.append([c.name, where(c.joints), _main_value(c), _nats(c.nats), best])
    header = ["cause", "where", "value (95 % interval)", "evidence [nats]", "best rival [nats]"]
    return table_text(header, rows) if rows else ""


def unit_of(key: str) -> str:
    """Return the unit of a parameter; nothing where it has none."""
    parts = key.split()[0].split("_")
    ends = ["_".join(parts[k:]) for k in range(len(parts))]
    units = UNITS | parameter_units()
    return next((units[x] for x in ends if x in units), "")


def _main_value(cause: NamedCause) -> str:
    """Return the first measured parameter, of the joint where the cause is clearest."""
    every = [(j, k, e) for j, found in cause.parameters.items() for k, e in found.items()]
    measured = [x for x in every if not isinstance(x[2].value, int)]  # no choice among a few
    if not measured:
        return "–"
    joint, key, e = measured[0]
    text = f"`{key}` {quantity(key, e)}"
    others = [x.value for j, k, x in measured if k == key and j != joint]
    single = [x for x in others if isinstance(x, float)]
    return f"{text} on joint {joint}, {span(single)} on the others" if single else text


def quantity(key: str, e: Estimate) -> str:
    """Return ``0.5 [0.4, 0.6] kg``, or some of these; stretches of time as ``2 to 3 s``."""
    values, ends = (e.value, e.ci95) if isinstance(e.value, list) else ([e.value], [e.ci95])
    each = []
    for value, (low, high) in zip(values, ends, strict=True):
        if isinstance(value, int):
            each.append(str(value))
        elif isinstance(value, list):
            each.append(f"{value[0]:.4g} to {value[1]:.4g}")
        else:
            each.append(f"{short(value)} [{short(low)}, {short(high)}]")
    more = ["…"] if len(each) > LISTED else []
    return f"{', '.join([*each[:LISTED], *more])} {unit_of(key)}".rstrip()


def _nats(value: float) -> str:
    return number(value, 0 if abs(value) >= 10 else 1)


def rivals(cause: NamedCause) -> list[str]:
    """Return its rivals and their nats, bold where the data cannot tell them from it."""
    bold = {name: f"**{name}**" for name in cause.confused_with}
    each = [f"{bold.get(name, name)} ({_nats(nats)})" for name, nats in cause.rivals]
    return each or list(bold.values())


def parameter_table(cause: NamedCause) -> str:
    """Return the parameters of a cause on each joint."""
    bound = ", **on its bound**"
    rows = [
        [f"joint {j}" if j else "arm", f"`{key}`", quantity(key, e) + bound * e.on_bound]
        for j, found in sorted(cause.parameters.items())
        for key, e in found.items()
    ]
    header = ["", "parameter", "value (95 % interval)"]
    return table_text(header, rows) if rows else ""


def not_shown(entries: Sequence[NotShown]) -> list[str]:
    """Return a line for each cause that these data do not show, with the numbers."""
    return [
        f"{x.name}, {where(x.joints)}: "
        + ", ".join(f"`{key}` {_plus_minus(*ends)} {unit_of(key)}".rstrip() for key, ends in each)
        for x in entries
        if (each := x.parameters.items())
    ]


def _plus_minus(low: float, high: float) -> str:
    """Return ``0 ± 6``: an interval's middle, with as many decimals as its half width."""
    half = short(high / 2 - low / 2, 2)
    return f"{number(low / 2 + high / 2, len(half.partition('.')[2]))} ± {half}"
