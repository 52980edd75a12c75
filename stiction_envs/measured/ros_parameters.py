"""Amplitude tables as parameter files of ROS 2: ``final.yaml`` beside ``final.csv``.

    /**:                        # any node; name yours instead where several listen
      ros__parameters:
        dither:
          joints: [joint7]      # joints that follow, in the order of final.csv
          joint7:               # name of the joint in the robot's model
            joint: 7            # number of the joint, from 1
            frequency_hz: 15.0
            amplitude_nm: 0.8
            waveform: sine
            offset_nm: 0.0
            gate_rad_s: 0.0     # 0: never gated

Every joint has every key, each of one type, as ROS 2 asks of a parameter; doubles read back bit for
bit. A controller whose parameters come from generate_parameter_library declares the keys below
``__map_joints`` with defaults of 0. ``--ros-args --params-file final.yaml`` loads the file.
Friction compensation is a group of its own (`control.compensation_files`).
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from stiction_envs.errors import StictionError
from stiction_envs.measured.csv_text import Line, check_columns, read_text
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.json_text import JsonRecord

ENDS = (".yaml", ".yml")
NODE, PARAMETERS, GROUP, JOINTS = "/**", "ros__parameters", "dither", "joints"
DITHER_NOTE = (
    "Dither torque A*w(2*pi*f*t) * exp(-(dq/gate)^2) + offset [N m, Hz, rad/s]; "
    + "gate 0: never gated."
)


@dataclass(frozen=True)
class ParameterGroup:
    """Rows that a file holds under one name."""

    name: str
    rows: Sequence[JsonRecord]
    """Cells by column, ``joint`` among them."""
    shared: Mapping[str, str] = field(default_factory=dict)
    """Cells that are the same for all joints."""
    note: str = ""
    """A line at the head of the file."""


def write_parameters(
    path: str | os.PathLike[str], groups: Sequence[ParameterGroup], names: Sequence[str]
) -> None:
    """Write groups of rows at once; ``names`` are those of joints 1 to n."""
    tree: dict[str, object] = {}
    for group in groups:
        joints = [names[row["joint"] - 1] for row in group.rows]
        own: dict[str, object] = {**group.shared, JOINTS: joints}
        tree[group.name] = own
        for name, row in zip(joints, group.rows, strict=True):
            own[name] = {k: v if isinstance(v, int | str) else float(v) for k, v in row.items()}
    text = yaml.safe_dump({NODE: {PARAMETERS: tree}}, sort_keys=False, allow_unicode=True)
    head = "".join(f"# {group.note}\n" for group in groups)
    write_text_atomic(path, head + text)


def read_parameters(
    path: str | os.PathLike[str],
    required: Sequence[str],
    optional: Sequence[str],
    *,
    group: str = GROUP,
    shared: Sequence[str] = (),
) -> list[Line]:
    """Read a group of such a file as lines of a table, one a joint.

    Every line gets the ``shared`` columns, which the file states once.

    Raises:
        StictionError: the file cannot be read, or is no such file.
    """
    expected = f"expected a parameter file of ROS 2 with {PARAMETERS}: {group}: {JOINTS}: [names]"
    try:
        tree = yaml.safe_load(read_text(path))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        raise StictionError(f"{path}{where}: no YAML: {expected}") from None
    nodes = tree.values() if isinstance(tree, dict) else ()
    found = [x for x in (_get(node, PARAMETERS, group) for node in nodes) if x is not None]
    if len(found) != 1:
        raise StictionError(f"{path}: {len(found)} nodes with {group}: {expected}")
    names = _get(found[0], JOINTS)
    if not isinstance(names, list) or not names:
        raise StictionError(f"{path}: {group}: no list of {JOINTS}: {expected}")
    common = {k: str(found[0][k]) for k in shared if k in found[0]}
    lines = []
    for name in names:
        where = f"{path}, {group}.{name}"
        row = _get(found[0], name) if isinstance(name, str) else None
        if not isinstance(row, dict):
            raise StictionError(f"{where}: missing: expected {', '.join(required)}")
        check_columns(where, [str(k) for k in row], required, optional)
        lines.append(Line(where, {str(k): str(v) for k, v in row.items()} | common))
    return lines


def is_parameters(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is one of YAML, by its name."""
    return Path(path).suffix.lower() in ENDS


def _get(tree: object, *keys: str) -> Any:
    for key in keys:
        tree = tree.get(key) if isinstance(tree, dict) else None
    return tree
