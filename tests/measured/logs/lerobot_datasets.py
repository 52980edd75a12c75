"""Folders as lerobot records them: its published schema, version 3 (and 2.1), without the package.

Source: lerobot, datasets/dataset_writer.py, datasets/feature_utils.py, motors/motors_bus.py.
"""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import parquet

Array = np.ndarray
SO101 = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
RANGES = {
    "shoulder_pan": (780, 3420),
    "shoulder_lift": (810, 3190),
    "elbow_flex": (905, 3103),
    "wrist_flex": (860, 3220),
    "wrist_roll": (140, 3970),
    "gripper": (2030, 3553),
}
TICK = 2 * np.pi / 4096


def write_calibration(path: Path, ranges: dict[str, tuple[int, int]] = RANGES) -> Path:
    """Write the calibration file that lerobot keeps of an arm."""
    motors = {
        name: {"id": k, "drive_mode": 0, "homing_offset": 0, "range_min": low, "range_max": high}
        for k, (name, (low, high)) in enumerate(ranges.items(), 1)
    }
    path.write_text(json.dumps(motors, indent=4))
    return path


def zero(name: str) -> float:
    """Return the step where a joint's angle is 0: the middle of its range, a gripper's end."""
    low, high = RANGES[name]
    return low if name == "gripper" else (low + high) / 2


def in_ticks(q: Array) -> Array:
    """Return angles (T, 6) [rad] as the encoders see them, whole steps within the ranges."""
    ticks = np.round(q / TICK + [zero(name) for name in SO101])
    return np.clip(ticks, *np.array([RANGES[name] for name in SO101]).T)


def normalised(ticks: Array, degrees: bool) -> Array:
    """Return steps (T, 6) as `MotorsBus._normalize` does, in single precision."""
    out = np.empty_like(ticks)
    for j, name in enumerate(SO101):
        low, high = RANGES[name]
        share = (ticks[:, j] - low) / (high - low)
        if name == "gripper":
            out[:, j] = 100 * share
        elif degrees:
            out[:, j] = (ticks[:, j] - (low + high) / 2) * 360 / 4095
        else:
            out[:, j] = 200 * share - 100
    return out.astype(np.float32)


def write_dataset(
    folder: Path,
    state: Array,
    action: Array | None,
    *,
    names: tuple[str, ...] = tuple(f"{x}.pos" for x in SO101),
    episodes: tuple[int, ...] | None = None,
    fps: int = 30,
    robot: str | None = "so101_follower",
    version: str = "v3.0",
) -> Path:
    """Write a dataset of ``observation.state`` (T, k) and ``action`` (T, m) into a new folder.

    ``names`` are those of the columns, ``episodes`` the frames of each episode (one by default);
    version v3.0 has all episodes in one file, v2.1 a file for each.
    """
    lengths = np.array(episodes or (len(state),))
    episode = np.repeat(np.arange(len(lengths)), lengths)
    frame = np.concatenate([np.arange(k) for k in lengths])
    columns = {"observation.state": state, **({} if action is None else {"action": action})}
    features = {
        key: {"dtype": "float32", "shape": [x.shape[1]], "names": list(names), "fps": fps}
        for key, x in columns.items()
    }
    for key in ("timestamp", "frame_index", "episode_index", "index", "task_index"):
        dtype = "float32" if key == "timestamp" else "int64"
        features[key] = {"dtype": dtype, "shape": [1], "names": None}
    new = version.startswith("v3")
    path = "chunk-{chunk_index:03d}/file-{file_index:03d}"
    info = {
        "codebase_version": version,
        "robot_type": robot,
        "fps": fps,
        "data_path": f"data/{path}.parquet",
        "video_path": f"videos/{{video_key}}/{path}.mp4",
        "features": features,
    }
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info, indent=4))
    (folder / "videos").mkdir()
    (folder / "videos" / "file-000.mp4").write_bytes(b"a film")

    def lists(x: Array) -> pa.Array:
        flat = pa.array(np.ascontiguousarray(x, np.float32).reshape(-1))
        return pa.FixedSizeListArray.from_arrays(flat, x.shape[1])

    table = pa.table(
        {
            **{key: lists(x) for key, x in columns.items()},
            "timestamp": (frame / fps).astype(np.float32),
            "frame_index": frame,
            "episode_index": episode,
            "index": np.arange(len(state)),
            "task_index": np.zeros(len(state), np.int64),
        }
    )
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    if new:
        parquet.write_table(table, data / "file-000.parquet")
    else:
        for k in range(len(lengths)):
            parquet.write_table(table.filter(episode == k), data / f"episode_{k:06d}.parquet")
    return folder
