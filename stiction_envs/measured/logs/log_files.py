"""Read joint logs of any kind of file into arrays, as they are."""

import os
import stat
from dataclasses import replace
from pathlib import Path

import numpy as np

from stiction_envs.errors import StictionError, unknown
from stiction_envs.measured.csv_text import refuse_pointer
from stiction_envs.measured.logs.columns import Wanted, joints_of
from stiction_envs.measured.logs.formats.base import LogFormat, RawLog
from stiction_envs.measured.logs.formats.registry import format_of, log_ends
from stiction_envs.measured.logs.joint_names import Naming, with_held
from stiction_envs.measured.logs.units import RADIANS, UNITS, to_radians

RESTS = 1e-3  # largest way of a sliding joint that rests [m]; assumed
PICKLES = (".pt", ".pth")
"""Files of PyTorch, which are not opened."""
DATES = (1e9, 4e9)  # times of logs as dates, 2001 to 2096 [s since 1970]; assumed
OF_PICKLES = (
    "expected .npz; of PACE's make it with d = torch.load(FILE, weights_only=True); "
    "numpy.savez('log.npz', t=d['time'], q=d['dof_pos'], q_cmd=d['des_dof_pos'])"
)
"""How a file's owner converts it. Keys of PACE: leggedrobotics/pace-sim2real,
scripts/pace/data_collection.py."""


def read_raw(path: str | os.PathLike[str], wanted: Wanted) -> RawLog:
    """Read the numbers of a log file of any kind, or of a folder that ROS 2 recorded into.

    Raises:
        StictionError: the file cannot be read, is too large, or is not a log of such a robot.
    """
    where, names, kind = os.fspath(path), wanted.naming, _kind(path)
    if names.units is not None and names.units not in UNITS:
        raise unknown("units", names.units, UNITS)
    every, count = with_held(names), wanted.n_joints + len(names.held)
    if names.held and joints_of(kind.names(where, every)) == count:
        raw = kind.read(where, replace(wanted, n_joints=count, naming=every))
        raw = _without_held(raw, names)
    else:
        raw = kind.read(where, wanted)
    if not len(raw.t):
        raise StictionError(f"{where}: no rows below the header: expected one second or more")
    for unit, parts in (("ms", 1e3), ("µs", 1e6), ("ns", 1e9)):
        if wanted.time and DATES[0] <= raw.t[0] / parts <= DATES[1]:
            raw.t /= parts
            raw.note(f"times are dates in {unit}")
    if not kind.has_units and names.units not in (None, RADIANS):
        units = [names.units] * wanted.n_joints
        for text in to_radians(where, raw.data, units, (), names.calibration):
            raw.note(f"joints {text}")
    return raw


def _without_held(raw: RawLog, naming: Naming) -> RawLog:
    """Take joints that the robot's model holds still out of a log; raise if one of them moves."""
    for place, name in naming.held:
        moved = float(np.ptp(raw.data["q"][:, place])) if len(raw.t) else 0.0
        if moved > RESTS:
            raise StictionError(
                f"{raw.source}: joint {name!r} slides by {moved:.3g} m: expected it to rest, since "
                "the robot's model holds it still"
            )
        raw.note(f"joint {name!r} rests: left out")
    drop = [place for place, _ in naming.held]
    raw.data = {k: np.delete(x, drop, axis=1) for k, x in raw.data.items()}
    return raw


def count_joints(path: str | os.PathLike[str], naming: Naming | None = None) -> int:
    """Return for how many joints a log has angles.

    Raises:
        StictionError: a log without angles, or that cannot be read.
    """
    found = joints_of(column_names(path, naming))
    if not found:
        raise StictionError(
            f"{path}: no column q1: expected t,q1..qn,tau1..taun; columns OURS=NAME renames"
        )
    return found


def column_names(path: str | os.PathLike[str], naming: Naming | None = None) -> list[str]:
    """Return our names of a log's columns, by `LogFormat.names`."""
    return _kind(path).names(os.fspath(path), naming or Naming())


def is_log(path: Path) -> bool:
    """Return whether there is a file, or a folder that is a log."""
    return path.is_file() or (path.is_dir() and format_of(path) is not None)


def no_log(path: Path, expected: str) -> StictionError:
    """Return the error of a path that is no log; ``expected`` is what a file there could be."""
    if path.is_dir():
        folders = "a folder of ROS 2, lerobot or SAGE"
        return StictionError(f"{path}: a directory: expected {expected}, or {folders}")
    return StictionError(f"{path}: no such file: expected {expected}")


def _kind(path: str | os.PathLike[str]) -> LogFormat:
    """Return the kind of log that is there; raise a StictionError where there is none."""
    where, ends = os.fspath(path), ", ".join(log_ends())
    kind = format_of(Path(path))
    # Asked before opening: a pipe or a device would never end.
    try:
        mode = os.stat(where).st_mode
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise StictionError(f"{where}: {reason.lower()}: expected a log file") from None
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise StictionError(f"{where}: no regular file: expected a log file ({ends})")
    refuse_pointer(where)
    if where.lower().endswith(PICKLES):
        raise StictionError(f"{where}: a pickle, which can run code: {OF_PICKLES}")
    if kind is None:
        if stat.S_ISDIR(mode):
            raise no_log(Path(path), f"a log file ({ends})")
        raise StictionError(f"{where}: unknown kind of file: expected one of {ends}")
    return kind
