"""SAGE's recordings: a folder with ``control.csv`` and ``state_motor.csv``.

Each has a row per sample, ``type,timestamp,positions[,velocities,torques]``, with the time in µs
and lists of the joints, whose names are in ``joint_list.txt``. Commands hold until the next one.
Torques without a sign (of an SO-101 they are sizes of currents) become ``current_abs``. Speeds are
not read: their unit is the motor's. A gripper from 0 to 1 is a share of its range (`logs.units`).
Source: isaac-sim2real/sage, sage/real_so101/so101_lerobot_collector.py, sage/real_unitree.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, opening
from stiction_envs.measured.checks.logs import is_unsigned
from stiction_envs.measured.csv_text import refuse_pointer
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.formats.base import (
    LogFormat,
    RawLog,
    Wanted,
    check_bytes,
    check_size,
    held,
)
from stiction_envs.measured.logs.joint_names import Naming, joints_in_order
from stiction_envs.measured.logs.units import PERCENT, RADIANS, is_gripper, to_radians

COMMANDS, STATES, NAMES = "control.csv", "state_motor.csv", "joint_list.txt"
_PER_SECOND = 1e6


class SageFolder(LogFormat):
    """Folder that SAGE's collectors write for one motion."""

    ends: ClassVar = ()
    inside: ClassVar = (COMMANDS, STATES)
    has_units: ClassVar = True

    def names(self, where: str, naming: Naming) -> list[str]:
        states = _table(Path(where, STATES))
        names = [f"q{j + 1}" for j in range(len(naming.joints) or states["positions"].shape[1])]
        signed = "torques" in states and not is_unsigned(states["torques"])
        return [*names, "q_cmd1", *(["tau1"] if signed else [])]

    def read(self, where: str, wanted: Wanted) -> RawLog:
        states = _table(Path(where, STATES))
        n = states["positions"].shape[1]
        names = _names(where, n)
        joints = joints_in_order(where, names, wanted.n_joints, wanted.naming)
        order = [names.index(x) for x in joints]
        t, keep = states["timestamp"], np.ones(len(states["timestamp"]), bool)
        data = {"q": states["positions"]}
        torques = states.get("torques")
        unsigned = torques is not None and is_unsigned(torques)
        if torques is not None and not (unsigned and wanted.drive == TORQUE):
            data["current_abs" if unsigned else "tau"] = torques
        if wanted.drive == TORQUE and "tau" not in data:
            raise StictionError(f"{where}: no torques with a sign: expected drive position")
        if wanted.drive == POSITION:
            commands = _table(Path(where, COMMANDS))
            if commands["positions"].shape[1] != n:
                raise StictionError(
                    f"{where}: commands of {commands['positions'].shape[1]} joints, states of {n}: "
                    "expected the same"
                )
            last, keep = held(commands["timestamp"], t)
            data["q_cmd"] = commands["positions"][last]
        rows = np.flatnonzero(keep)
        data = {k: np.ascontiguousarray(x[keep][:, order]) for k, x in data.items()}
        log = RawLog(
            source=where,
            t=t[keep] / _PER_SECOND if wanted.time else np.arange(float(len(rows))),
            data=data,
            run=np.zeros(len(rows), np.int64),
            place=lambda i: f"{where}, {STATES}, line {rows[i] + 2}",
            ignored=("velocities",) if "velocities" in states else (),
        )
        text = f"SAGE: joints 1 to {len(joints)} are {', '.join(joints)}"
        text += "; torques have no sign: sizes of currents" * unsigned
        log.note(text)
        if not len(rows):
            return log
        # angles are in rad where nobody says another unit, but for grippers between 0 and 1
        units = [wanted.naming.units or RADIANS] * len(joints)
        for j, name in enumerate(joints):
            low, high = log.data["q"][:, j].min(), log.data["q"][:, j].max()
            if wanted.naming.units is None and is_gripper(name) and 0 <= low < high <= 1:
                units[j] = PERCENT
        for text in to_radians(where, log.data, units, joints, wanted.naming.calibration):
            log.note(text)
        return log


def _names(where: str, n: int) -> list[str]:
    """Return the names of the joints; numbers where no file says them."""
    path = Path(where, NAMES)
    if not path.is_file():
        return [f"joint{j + 1}" for j in range(n)]
    try:
        with path.open(encoding="utf-8") as file:
            names = [x.strip() for x in file.read(2**16).splitlines() if x.strip()]
    except (OSError, UnicodeDecodeError):
        names = []
    if len(names) != n or len(set(names)) != n:
        raise StictionError(f"{path}: {len(names)} names: expected those of {n} joints, one a line")
    return names


def _table(path: Path) -> dict[str, Array]:
    """Read ``timestamp`` (T,) and lists of joints (T, n) by their columns."""
    parts: dict[str, list[list[float]]] = {}
    stamps: list[float] = []
    for number, row in _rows(path):
        try:
            stamps.append(float(row["timestamp"]))
            for name in ("positions", "velocities", "torques"):
                if name in row:
                    values = [float(x) for x in json.loads(row[name])]
                    parts.setdefault(name, []).append(values)
        except (ValueError, TypeError, KeyError, RecursionError):
            raise StictionError(
                f"{path}, line {number}: no time [µs] and lists of numbers: expected "
                "type,timestamp,positions as SAGE writes them"
            ) from None
        check_size(str(path), len(stamps), 1 + sum(len(x[0]) for x in parts.values()))
    if not stamps:
        raise StictionError(f"{path}: no rows: expected one second or more")
    if "positions" not in parts:
        raise StictionError(f"{path}: missing column 'positions': expected SAGE's columns")
    n = len(parts["positions"][0])
    for name, lists in parts.items():
        bad = next((i for i, x in enumerate(lists) if len(x) != n), None)
        if bad is not None or len(lists) != len(stamps) or not n:
            raise StictionError(
                f"{path}, line {(bad or 0) + 2}: {name} of other joints than above: expected {n} "
                "values in every row"
            )
    return {"timestamp": np.array(stamps), **{k: np.array(x) for k, x in parts.items()}}


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Return rows by column, each with the number of its line."""
    refuse_pointer(path)
    try:
        with opening(path, "SAGE's CSV in UTF-8"):
            check_bytes(str(path), path.stat().st_size)
            with path.open(encoding="utf-8", newline="") as file:
                reader = csv.DictReader(file)
                for row in reader:
                    yield reader.line_num, {k: v for k, v in row.items() if k and v is not None}
    except (UnicodeDecodeError, csv.Error):
        raise StictionError(
            f"{path}: no text between commas: expected SAGE's CSV in UTF-8"
        ) from None
