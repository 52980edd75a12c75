"""A recording of an SO-101: ``python -m stiction_envs.hidden.example_recording``.

To try `stiction diagnose` with. A simulated SO-101 whose servos and friction are about those of a
real one (``benchmarks/servo/servo_friction.md``) and whose links are 5 % off. Writes into a new
folder: ``recording`` as lerobot does (version 3, 30 Hz, degrees) with ``calibration.json``, another
motion ``other.csv``, the arm as its user knows it, ``so101.urdf`` without meshes and
``so101.toml``, and the truth, ``hidden.json``. Needs the packages example-robot-data and pyarrow.
"""

from __future__ import annotations

import json
import sys
import sysconfig
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.gap.servo.arm import simulate_arm
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.parameters import INDEX, absent
from stiction_envs.hidden.example_command import log_csv, run_writer
from stiction_envs.hidden.imperfect_arms import scattered
from stiction_envs.hidden.servo_logs import ENCODER, commands
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.json_text import write_json
from stiction_envs.robots import load_arm
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import inertial_parameters

Array = NDArray[np.float64]
SEED = 101
FPS = 30
"""Rows per second, lerobot's default."""
URDF = "cmeel.prefix/share/example-robot-data/robots/so_arm_description/urdf/so101.urdf"
START = (0.0, -0.6, 0.7, 0.4, 0.0, 0.8)
"""Middle of the motion [rad]; assumed."""
SCATTER = 0.05
"""Standard deviation of the links' inertia [-]; assumed."""
SO101 = {
    "stiffness": (11.3, 12.5, 11.0, 10.0, 11.3, 11.3),
    "damping": (0.62, 1.1, 0.5, 0.57, 0.51, 0.9),
    "stiction": (0.1, 0.05, 0.45, 0.15, 0.13, 0.1),
    "load": (0.0, 0.5, 0.0, 0.0, 0.0, 0.0),
}
"""Parameters of the servos by joint (`gap.servo.parameters`), assumed: about those found of a real
arm (``benchmarks/servo/servo_friction.md``)."""
INTERFACE = """# Beside so101.urdf: what it does not say.
[interface.controller_rate_hz] # of commands
value = 50.0
unit = "Hz"
source = "isaac-sim2real/sage: a real one was logged at 50 Hz through the bus of lerobot"
"""
RANGES = ((798, 3298), (910, 3186), (947, 3149), (967, 3129), (259, 3911), (2030, 3281))
"""Encoder steps of the calibrated ranges, of which zero is the middle; of the jaw, an end.
Assumed."""


def write_recording(folder: Path, *, seconds: float = 90.0, second: float = 45.0) -> None:
    """Write recording, second motion, arm and what is hidden in it.

    Args:
        folder: that is not there yet.
        seconds: length of the recording [s].
        second: length of ``other.csv`` [s].

    Raises:
        StictionError: the folder is there already, or a package is missing.
    """
    if folder.exists():
        raise StictionError(f"{folder}: exists already: expected a new folder")
    source = Path(sysconfig.get_path("purelib")) / URDF
    if not source.is_file():
        raise StictionError(f"{source}: no such file: expected the package example-robot-data")
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise missing_extra("a recording of lerobot", "pyarrow", "parquet") from None
    folder.mkdir(parents=True)
    write_text_atomic(folder / "so101.urdf", without_meshes(source))
    write_text_atomic(folder / "so101.toml", INTERFACE)
    arm = load_arm(folder / "so101.urdf")
    parameters = np.tile(absent(), (arm.n, 1))
    for name, values in SO101.items():
        parameters[:, INDEX[name]] = values
    rng = np.random.default_rng(SEED)
    real = with_inertias(arm, scattered(inertial_parameters(arm.pinocchio()), SCATTER, rng))
    logs = []
    for length in (seconds, second):
        t = np.arange(0.0, length, 1.0 / FPS)
        q_cmd = in_steps(commands(arm, t, rng, np.array(START)))
        logs.append(ServoLog(source="plan", t=t, q=q_cmd.copy(), dq=None, q_cmd=q_cmd))
    load = np.array([float(np.abs(m.gravity).mean()) for m in joint_motions(arm, logs)])
    recorded, other = simulate_arm(real, logs, parameters, load, threads=1)
    _write_dataset(folder / "recording", in_steps(recorded), logs[0].q_cmd, arm.joint_names)
    motors = {
        name: {"id": j + 1, "drive_mode": 0, "homing_offset": 0, "range_min": a, "range_max": b}
        for j, (name, (a, b)) in enumerate(zip(arm.joint_names, RANGES, strict=True))
    }
    write_text_atomic(folder / "calibration.json", json.dumps(motors, indent=4) + "\n")
    text = log_csv(logs[1].t, q_cmd=logs[1].q_cmd, q=in_steps(other))
    write_text_atomic(folder / "other.csv", text)
    write_json(folder / "hidden.json", {name: list(values) for name, values in SO101.items()})


def without_meshes(urdf: Path) -> str:
    """Return a URDF without what is seen and what collides."""
    root = ET.parse(urdf).getroot()
    for link in root.iter("link"):
        for name in ("visual", "collision"):
            for found in link.findall(name):
                link.remove(found)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def in_steps(q: Array) -> Array:
    """Return angles (T, 6) in whole steps of the encoders, within the calibrated ranges [rad]."""
    low, high = np.array(RANGES, dtype=np.float64).T
    zero = (low + high) / 2
    zero[-1] = low[-1]
    steps = np.clip(np.round(q / ENCODER + zero), low, high)
    out: Array = (steps - zero) * ENCODER
    return out


def _as_lerobot(q: Array) -> Array:
    """Return angles as lerobot records them: degrees of 4095 steps a turn, the jaw 0 to 100."""
    steps = q / ENCODER
    out = steps * 360 / 4095
    out[:, -1] = 100 * steps[:, -1] / (RANGES[-1][1] - RANGES[-1][0])
    return out


def _write_dataset(folder: Path, q: Array, q_cmd: Array, names: Sequence[str]) -> None:
    """Write a LeRobotDataset (v3.0) of one episode, to its published schema."""
    import pyarrow as pa
    from pyarrow import parquet

    columns = {"observation.state": _as_lerobot(q), "action": _as_lerobot(q_cmd)}
    frames, of = np.arange(len(q)), [f"{name}.pos" for name in names]
    numbers: dict[str, NDArray[np.float32] | NDArray[np.int64]] = {
        "timestamp": (frames / FPS).astype(np.float32),
        "frame_index": frames,
        "episode_index": 0 * frames,
        "index": frames,
        "task_index": 0 * frames,
    }
    features = {k: {"dtype": "float32", "shape": [len(of)], "names": of} for k in columns}
    features |= {k: {"dtype": str(x.dtype), "shape": [1], "names": []} for k, x in numbers.items()}
    info = {
        "codebase_version": "v3.0",
        "robot_type": "so101_follower",
        "total_episodes": 1,
        "total_frames": len(q),
        "fps": FPS,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "features": features,
    }
    (folder / "meta").mkdir(parents=True)
    write_json(folder / "meta" / "info.json", info)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    lists = {
        k: pa.FixedSizeListArray.from_arrays(pa.array(x.astype(np.float32).ravel()), len(of))
        for k, x in columns.items()
    }
    table = pa.table({**lists, **numbers})
    parquet.write_table(table, folder / "data" / "chunk-000" / "file-000.parquet")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code: 0 done, 2 bad input."""
    return run_writer(
        "stiction_envs.hidden.example_recording",
        "Write a simulated recording of an SO-101, as lerobot does.",
        write_recording,
        "recording, calibration.json, other.csv, so101.urdf",
        arguments,
    )


if __name__ == "__main__":
    sys.exit(main())
