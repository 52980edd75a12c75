"""LeRobotDataset folders, versions 2 and 3: ``meta/info.json`` beside Parquet files in ``data/``.

| in the dataset | becomes |
|---|---|
| ``observation.state``, ``NAME.pos`` | ``q`` |
| ``observation.state``, ``NAME.vel``, ``NAME.torque`` | ``dq``, ``tau`` [N·m] |
| ``action``, ``NAME.pos`` | ``q_cmd`` |
| ``episode_index`` | ``run`` |
| ``frame_index`` over ``fps``, or ``timestamp`` where it is another time | ``t`` |

The recorder reads the state, then sends the action, and writes both in one frame. Its time is
nominal: frame over rate. What the angles are measured in is not written (`logs.units`).
Source: lerobot, datasets/dataset_writer.py, motors/motors_bus.py, robots/openarm_follower. The
``lerobot`` package is not needed.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, opening
from stiction_envs.measured.csv_text import refuse_pointer
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.formats.base import LogFormat, RawLog, Wanted, check_size
from stiction_envs.measured.logs.formats.column_files import opened
from stiction_envs.measured.logs.joint_names import Naming, joints_in_order
from stiction_envs.measured.logs.units import DEGREES, PERCENT, is_gripper, recognised, to_radians
from stiction_envs.reporting.json_text import JsonRecord

if TYPE_CHECKING:
    from pyarrow import ChunkedArray

INFO = "meta/info.json"
STATE, ACTION = "observation.state", "action"
MOST_INFO_BYTES = 2**24  # most bytes of ``meta/info.json``; assumed
NOMINAL = 1e-3
"""Times are frames over the rate if they differ by less [s]; assumed, float32 rounds them."""
ALWAYS_DEGREES = ("openarm", "damiao")
"""Parts of the names of robots whose driver knows degrees only. Source: lerobot,
robots/openarm_follower, motors/damiao."""
_CHANNELS = {"pos": "q", "vel": "dq", "torque": "tau"}


class LeRobotDataset(LogFormat):
    """Folder that lerobot records into."""

    ends: ClassVar = ()
    inside: ClassVar = (INFO,)
    has_units: ClassVar = True

    def names(self, where: str, naming: Naming) -> list[str]:
        features = _Features(where)
        names = [f"q{j + 1}" for j in range(len(naming.joints or features.motors))]
        return [
            *names,
            *(["tau1"] if features.torque else []),
            *(["q_cmd1"] if features.action else []),
        ]

    def read(self, where: str, wanted: Wanted) -> RawLog:
        features = _Features(where)
        for drive, channel, names in (
            (TORQUE, "NAME.torque in observation.state", features.torque),
            (POSITION, "action", features.action),
        ):
            if wanted.drive == drive and not names:
                raise StictionError(f"{where}: no {channel}: expected it for drive {drive}")
        joints = joints_in_order(where, features.motors, wanted.n_joints, wanted.naming)
        table = _table(where, features)
        episode, frame = table["episode_index"].astype(int), table["frame_index"].astype(int)
        data = {
            channel: np.ascontiguousarray(table[STATE][:, [names[x] for x in joints]])
            for channel, names in features.state.items()
            if all(x in names for x in joints)
        }
        if wanted.drive == POSITION:
            missing = [x for x in joints if x not in features.action]
            if missing:
                raise StictionError(f"{where}: action has no {missing[0]!r}: expected all joints")
            of = [features.action[x] for x in joints]
            data["q_cmd"] = np.ascontiguousarray(table[ACTION][:, of])
        t = frame / features.fps
        nominal = not (np.abs(table["timestamp"] - t).max(initial=0.0) > NOMINAL)
        log = RawLog(
            source=where,
            t=np.arange(float(len(t))) if not wanted.time else t if nominal else table["timestamp"],
            data=data,
            run=np.r_[0, np.cumsum(np.diff(episode) != 0)][: len(t)],
            place=lambda i: f"{where}, episode {episode[i]}, frame {frame[i]}",
        )
        clock = f"times are frames at {features.fps:g} Hz, not measured" if nominal else "timestamp"
        log.note(f"lerobot's dataset: joints 1 to {len(joints)} are {', '.join(joints)}; {clock}")
        if len(t):
            _convert(where, log, features.robot, joints, wanted.naming)
        return log


class _Features:
    """Facts about a dataset in its ``meta/info.json``."""

    def __init__(self, where: str) -> None:
        path = Path(where, INFO)
        refuse_pointer(path)
        with opening(path, "lerobot's info.json"):
            if path.stat().st_size > MOST_INFO_BYTES:
                raise StictionError(f"{path}: over {MOST_INFO_BYTES >> 20} MiB: expected lerobot's")
            data = path.read_bytes()
        try:
            info = json.loads(data.decode())
            fps, features = float(info["fps"]), info["features"]
            self.robot = str(info.get("robot_type") or "")
            state = _names(path, STATE, features)
            action = _names(path, ACTION, features) if ACTION in features else []
        except StictionError:
            raise
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            raise StictionError(
                f"{path}: damaged or no info.json of lerobot: expected fps, features, and "
                f"{STATE!r} among them"
            ) from None
        if not 0 < fps < 1e6:
            raise StictionError(f"{path}: fps is {fps:g}: expected frames a second")
        self.fps = fps
        self.state = _by_channel(path, state)
        """Column of each motor, by channel."""
        self.width = {STATE: len(state), **({ACTION: len(action)} if action else {})}
        """Columns of the state and of the action."""
        self.motors = list(self.state.get("q", {}))
        self.torque = self.state.get("tau", {})
        self.action = _by_channel(path, action).get("q", {})


def _names(path: Path, name: str, features: JsonRecord) -> list[str]:
    """Return the names of a feature's columns; their numbers where it has none."""
    names = (feature := features[name]).get("names")
    if isinstance(names, dict):  # version 2: {"motors": [...]}
        (names,) = names.values()
    (size,) = feature["shape"]
    if names is None:
        names = range(1, int(size) + 1)
    names = [str(x) for x in names]
    if len(names) != size or size > 1000:
        raise StictionError(
            f"{path}: {name!r} has {len(names)} names for {size} columns: expected one each"
        )
    return names


def _by_channel(path: Path, names: Sequence[str]) -> dict[str, dict[str, int]]:
    """Return the columns of motors by channel; a name without an ending is an angle."""
    found: dict[str, dict[str, int]] = {}
    for i, name in enumerate(names):
        motor, dot, end = name.rpartition(".")
        if not dot or end not in _CHANNELS:
            motor, end = name, "pos"
        if found.setdefault(_CHANNELS[end], {}).setdefault(motor, i) != i:
            raise StictionError(f"{path}: {name[:40]!r} is there twice: expected one")
    return found


def _table(where: str, features: _Features) -> dict[str, Array]:
    """Read the columns of all data files, rows in the order of episodes and frames."""
    files = sorted(Path(where, "data").rglob("*.parquet"))
    if not files:
        raise StictionError(f"{where}: no .parquet in data/: expected a whole dataset of lerobot")
    width = {**features.width, **dict.fromkeys(("timestamp", "frame_index", "episode_index"), 1)}
    parts: dict[str, list[Array]] = {name: [] for name in width}
    rows = 0
    for path in files:
        damaged = "damaged, or not as info.json says: expected lerobot's Parquet"
        with opened(where, path, damaged) as file:
            rows += file.metadata.num_rows
            check_size(where, rows, sum(width.values()))
            missing = sorted(set(width) - set(file.schema_arrow.names))
            if missing:
                raise StictionError(f"{path}: missing column {missing[0]!r}: expected lerobot's")
            table = file.read(columns=list(width))
            for name, count in width.items():
                parts[name].append(_numbers(table.column(name), count))
    whole = {
        name: np.concatenate(of)
        if width[name] > 1 or name in (STATE, ACTION)
        else np.concatenate(of)[:, 0]
        for name, of in parts.items()
    }
    order = np.lexsort((whole["frame_index"], whole["episode_index"]))
    return {name: array[order] for name, array in whole.items()}


def _numbers(column: ChunkedArray, width: int) -> Array:
    """Return a column of numbers, or of lists of ``width`` numbers, as (T, width)."""
    flat = column.combine_chunks()
    while hasattr(flat.type, "value_type"):
        flat = flat.flatten()
    array = np.asarray(flat.to_numpy(zero_copy_only=False), np.float64)
    return array.reshape(len(column), width)


def _convert(where: str, log: RawLog, robot: str, joints: tuple[str, ...], naming: Naming) -> None:
    """Bring angles to rad; a person, the robot or the encoders' steps say what they are."""
    unit, why = naming.units, "as asked"
    if unit is None and any(x in robot.lower() for x in ALWAYS_DEGREES):
        unit, why = DEGREES, f"robot_type is {robot!r}"
    if unit is None:
        unit, why = recognised(log.data["q"], joints)
    if unit is None:
        raise StictionError(
            f"{where}: its angles may be degrees, percent of the calibrated range or radians, the "
            "recording does not say: expected units deg, percent (with a calibration file), "
            "ticks or rad"
        )
    hand = unit == DEGREES and not any(x in robot.lower() for x in ALWAYS_DEGREES)
    units = [PERCENT if hand and is_gripper(x) else unit for x in joints]
    said = to_radians(where, log.data, units, joints, naming.calibration)
    log.note(f"angles are in {unit} ({why})" + "".join(f"; {x}" for x in said))
