"""Files of friction compensation: ``compensation.csv``, and its part of ``final.yaml``.

    joint,kind,gain_nm[,speed_rad_s][,error_rad][,load_gain] …

``kind`` is the same in every row, and may be missing if the caller names it. Further columns
are fields of the law (`laws.Field.column`, unit in the name); an empty cell is the default.
In YAML the kind is given once:

    compensation:
      kind: push
      joints: [joint1, …]
      joint1: {joint: 1, gain_nm: 0.9, speed_rad_s: 0.02, error_rad: 0.002, load_gain: 0.0}
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from stiction_envs.control.compensation import Compensation, law_named
from stiction_envs.control.laws import LAWS
from stiction_envs.errors import StictionError
from stiction_envs.measured.csv_text import Line, read_lines, write_rows
from stiction_envs.measured.ros_parameters import ParameterGroup, is_parameters, read_parameters
from stiction_envs.measured.tables import AmplitudeRow, write_final

COLUMNS = ("joint", "gain_nm")  # Columns that every table of gains has
KIND, GROUP = "kind", "compensation"
_ENDS = (".csv", ".yaml", ".yml")


def is_file(text: str | Path) -> bool:
    """Return whether text names a file of gains rather than a kind."""
    return str(text).lower().endswith(_ENDS)


def read_compensation(
    path: str | Path, kind: str | None, n: int, factor: float = 1.0
) -> Compensation:
    """Read a table of gains, CSV or a ``final.yaml``; missing joints are not compensated.

    Args:
        path: the file.
        kind: one of `LAWS`; None for the file's.
        n: joints of the arm.
        factor: multiplies the friction that the gains stand for [-].

    Raises:
        StictionError: a file that cannot be read, another kind, a joint twice, or bad numbers.
    """
    optional = (KIND, *dict.fromkeys(x.column for law in LAWS.values() for x in law.fields))
    if is_parameters(path):
        lines = read_parameters(path, COLUMNS, optional, group=GROUP, shared=(KIND,))
    else:
        lines = read_lines(path, COLUMNS, optional)
    kind = _kind(path, lines, kind)
    law = LAWS[kind]
    columns = {"gain_nm": "gain"} | {field.column: field.name for field in law.fields}
    values = {"gain": np.zeros(n)}
    values |= {f.name: np.full(n, np.nan if f.default is None else f.default) for f in law.fields}
    seen: set[int] = set()
    for line in lines:
        joint = line.whole("joint", 1, n)
        if joint in seen:
            raise line.error(f"joint {joint} is there twice: expected one line per joint")
        seen.add(joint)
        for column, text in line.fields.items():
            if column in ("joint", KIND):
                continue
            if column not in columns:
                raise line.error(f"{column}: {kind} has none: expected {', '.join(columns)}")
            if not text and column != "gain_nm":
                continue
            values[columns[column]][joint - 1] = line.number(column)
    if not values["gain"].any():
        raise StictionError(f"{path}: compensates no joint: expected a gain_nm above 0")
    for field in law.fields:
        missing = np.isnan(values[field.name])
        for j in np.flatnonzero(missing & (values["gain"] > 0)):
            raise StictionError(f"{path}: joint {j + 1}: {kind} needs {field.column}")
        values[field.name][missing] = 1.0  # a joint that is not compensated may have any
    try:
        return Compensation(kind=kind, **values).times(factor)
    except StictionError as error:
        raise StictionError(f"{path}: {error}") from None


def _kind(path: str | Path, lines: Sequence[Line], kind: str | None) -> str:
    if kind is not None:
        law_named(kind)
    for line in lines:
        own = line.fields.get(KIND)
        if not own:
            continue
        line.name(KIND, tuple(LAWS) if kind is None else (kind,))
        kind = own
    if kind is None:
        raise StictionError(f"{path}: no {KIND}: expected a column {KIND}, {', '.join(LAWS)}")
    return kind


def compensation_rows(found: Compensation) -> list[dict[str, float]]:
    """Return one row per joint, cells by column; every float reads back bit for bit."""
    columns = {"gain_nm": found.gain}
    columns |= {f.column: found.numbers[f.name] for f in LAWS[found.kind].fields}
    return [
        {"joint": j + 1, **{column: float(x[j]) for column, x in columns.items()}}
        for j in range(found.n)
    ]


def write_compensation(path: Path, found: Compensation) -> None:
    """Write ``compensation.csv``, in the format that `read_compensation` reads."""
    first: dict[str, object] = {"joint": 0, KIND: found.kind}
    write_rows(path, [first | row for row in compensation_rows(found)])


def write_treatment(
    folder: Path,
    dither: Iterable[AmplitudeRow],
    compensation: Compensation | None,
    joint_names: Sequence[str],
) -> None:
    """Write ``final.csv``, dither or else gains, ``final.yaml``, both, and ``compensation.csv``."""
    groups, dither = [], list(dither)
    if compensation is not None:
        write_compensation(folder / "compensation.csv", compensation)
        if not dither:
            write_compensation(folder / "final.csv", compensation)
        note = f"Friction compensation, {LAWS[compensation.kind].what}; units in the names."
        rows = compensation_rows(compensation)
        groups.append(ParameterGroup(GROUP, rows, {KIND: compensation.kind}, note))
    write_final(folder, dither, joint_names, groups)
