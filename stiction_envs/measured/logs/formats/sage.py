"""SAGE's recordings: a folder with ``control.csv`` and ``state_motor.csv``.

Each has a row per sample, ``type,timestamp,positions[,velocities,torques]``, with the time in µs
and lists of the joints, whose names are in ``joint_list.txt``. Commands hold until the next one.
Torques without a sign (of an SO-101 they are sizes of currents) become ``current_abs``. Speeds are
not read: their unit is the motor's. A gripper from 0 to 1 is a share of its range (`logs.units`).
Source: isaac-sim2real/sage, sage/real_so101/so101_lerobot_collector.py, sage/real_unitree.
"""

import json
from pathlib import Path
from typing import ClassVar

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.logs import is_unsigned
from stiction_envs.measured.csv_text import read_lines, read_text
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
OTHERS = ("velocities", "torques")
"""Optional columns."""
MOST_BYTES = 2**28  # most bytes of a file; assumed: hours
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
    names = read_text(path).split()
    if len(names) != n or len(set(names)) != n:
        raise StictionError(f"{path}: {len(names)} names: expected those of {n} joints, one a line")
    return names


def _table(path: Path) -> dict[str, Array]:
    """Read ``timestamp`` (T,) and lists of joints (T, n) by their columns."""
    check_bytes(str(path), path.stat().st_size, MOST_BYTES)
    parts: dict[str, list[list[float]]] = {}
    stamps: list[float] = []
    for line in read_lines(path, ("type", "timestamp", "positions"), OTHERS):
        try:
            stamps.append(float(line.fields["timestamp"]))
            for name in ("positions", *OTHERS):
                if name in line.fields:
                    values = [float(x) for x in json.loads(line.fields[name])]
                    parts.setdefault(name, []).append(values)
        except (ValueError, TypeError, RecursionError):
            raise line.error("no time [µs] and lists of numbers: expected SAGE's rows") from None
        check_size(str(path), len(stamps), 1 + sum(len(x[0]) for x in parts.values()))
        n = len(parts["positions"][0])
        for name, lists in parts.items():
            if len(lists[-1]) != n or not n:
                raise line.error(f"{name} of other joints than above: expected {n or 'some'}")
    return {"timestamp": np.array(stamps), **{k: np.array(x) for k, x in parts.items()}}
