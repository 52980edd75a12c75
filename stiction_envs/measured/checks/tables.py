"""Which rules apply to which table: the thesis's twelve, and files of the same forms."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.rules import (
    Bases,
    Defect,
    Row,
    Setting,
    check_amplitudes,
    check_measurements,
    check_percentages,
    check_repeats,
    check_signs,
    check_sje,
    grouped,
    joint_scale,
    number,
    place,
    setting_key,
)
from stiction_envs.measured.checks.thesis_forms import (
    check_differences,
    check_fits,
    check_growth,
    check_parameters,
    check_units,
)
from stiction_envs.measured.csv_text import header_of, read_lines
from stiction_envs.measured.tables import KEY, SJE_COLUMNS, typed_cell

FORMS: dict[str, tuple[str, ...]] = {
    "SJE table": SJE_COLUMNS,
    "4.5-4.8": (*KEY, "frequency_Hz", "scale", "tau_sje_Nm", "change_pct"),
    "4.9": (
        *(*KEY, "frequency_Hz", "scale", "tau_base_Nm"),
        *("tau_intermediate_Nm", "tau_final_Nm", "final_set_by_hand"),
    ),
    "4.10": (*KEY, "amplitude_set", "tau_base_Nm", "tau_sje_Nm", "change_pct"),
    "4.11": (
        *("robot", "subtable", "axis"),
        *("mean_error_dither", "mean_error_no_dither", "diff", "unit_printed"),
    ),
    "4.2": ("robot", "joint", "direction", "quantity", "unit", "value"),
    "4.1": ("robot", "joint", "quantity", "unit", "value"),
    "A.1": ("robot", "joint", "direction", "intercept_Nm", "slope_Nms_per_rad", "r2"),
    "4.3, 4.4": (*KEY, "tau_base_Nm"),
}
"""Columns by which a table is recognised, first match first; others may be there too."""
_REPEATED = {
    "tau_base_Nm": "",
    "intercept_Nm": ", intercept",
    "lsm_intercept_Nm": ", intercept",
    "slope_Nms_per_rad": ", slope",
    "r2": ", r2",
}
"""Columns of numbers that several tables print, and what they are called."""


def read_rows(path: str | os.PathLike[str]) -> list[dict[str, str]]:
    """Rows of a table as printed; its form is known and each number in it is one."""
    header = header_of(path)
    form = form_of(header)
    if header and form is None:
        shown = "; ".join(f"{','.join(c)} ({name})" for name, c in FORMS.items())
        raise StictionError(f"{path}: unknown columns {','.join(header)}: expected one of {shown}")
    lines = read_lines(path, header)
    for line in lines:
        for column in FORMS[form or ""]:
            typed_cell(line, column)
    return [line.fields for line in lines]


def form_of(columns: Sequence[str]) -> str | None:
    """Name in :data:`FORMS` of the table with these columns; None if there is none."""
    return next((name for name, need in FORMS.items() if set(need) <= set(columns)), None)


def check_tables(tables: Mapping[str, Sequence[Row]]) -> list[Defect]:
    """Apply each rule to the tables it fits; ``tables`` are rows as printed by table name.

    Tables that print no base torques use those of the other tables.
    """
    forms = {name: form_of(list(rows[0])) for name, rows in tables.items() if rows}
    rules = _rules(_base_torques(tables))
    found = []
    for name, form in forms.items():
        for rule in rules.get(form or "", ()):
            found += [replace(defect, table=name) for defect in rule(tables[name])]
    found += check_measurements(_measurements(tables, forms))
    printed = _printed_quantities(tables)
    found += check_repeats(x for x in printed if not x[1].endswith(", r2"))
    # three digits of R² are enough: it has no resolution of its own
    found += check_repeats((x for x in printed if x[1].endswith(", r2")), enough_digits=3)
    return found


def _rules(bases: Bases) -> dict[str, Sequence[Callable[[Sequence[Row]], Iterable[Defect]]]]:
    """Return the rules of each form that look at one table by itself."""
    dithered = (check_signs, partial(check_percentages, bases=bases))
    return {
        "SJE table": (check_sje,),
        "4.3, 4.4": (check_signs,),
        "4.5-4.8": dithered,
        "4.10": dithered,
        "4.9": (check_signs, check_amplitudes),
        "4.11": (check_units, check_differences, check_growth),
        "4.1": (check_parameters,),
        "A.1": (partial(check_fits, bases=bases),),
    }


def _base_torques(tables: Mapping[str, Sequence[Row]]) -> dict[Setting, str]:
    """Printed base torques [N·m], of dithered tables before others (4.7 refers to 4.6, not 4.3)."""
    bases: dict[Setting, str] = {}
    for dithered in (True, False):
        for rows in tables.values():
            for row in rows:
                if "tau_base_Nm" in row and ("change_pct" in row) is dithered:
                    bases.setdefault(setting_key(row), str(row["tau_base_Nm"]))
    return bases


def _measurements(
    tables: Mapping[str, Sequence[Row]], forms: Mapping[str, str | None]
) -> list[Row]:
    """Dithered readings of all tables with frequency and scale, those of 4.10 through 4.9.

    Verification rows whose amplitude is not scale × base (``final``) repeat nothing.
    """
    chosen: dict[Setting, dict[str, str]] = {}
    for name in (name for name, form in forms.items() if form == "4.9"):
        for joint in grouped(tables[name], lambda row: setting_key(row)[:2]).values():
            scale = str(joint_scale(joint))
            for row in joint:
                setting = {"frequency_Hz": row["frequency_Hz"], "scale": scale}
                chosen[setting_key(row)] = setting
    found: list[Row] = []
    for name, form in forms.items():
        for row in tables[name]:
            if form == "4.5-4.8":
                found.append({**row, "table": name})
            elif form == "4.10" and row["amplitude_set"] == "intermediate":
                known = chosen.get(setting_key(row))
                found += [{**row, "table": name, **known}] if known else []
    return found


def _printed_quantities(tables: Mapping[str, Sequence[Row]]) -> list[tuple[str, str, str]]:
    """(table, quantity, number) for whatever tables print more than once."""
    found = []
    for name, rows in tables.items():
        for row in rows:
            for column, what in _REPEATED.items():
                if column in row:
                    # The line of a joint and direction is one for both poses.
                    keys = ("robot", "joint", "direction") if what else KEY
                    where = place({key: row[key] for key in keys}) + what
                    found.append((name, where, str(row[column])))
            if "quantity" in row and "direction" in row:
                found.append((name, f"{place(row)}, {row['quantity']}", str(row["value"])))
            elif row.get("quantity") == "mass":
                where = f"{row['robot']} link {number(row, 'joint')}, mass"
                found.append((name, where, str(row["value"])))
    return found
