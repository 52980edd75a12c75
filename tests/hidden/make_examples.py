"""Simulate the logs that are shipped as examples: ``python -m tests.hidden.make_examples``.

The arm of ``so101`` is that of the package example-robot-data (TheRobotStudio's SO-ARM100,
Apache-2.0) without meshes.
"""

import shutil
import tempfile
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import numpy as np

from benchmarks.servo.blind_servo_logs import robot_file
from stiction_envs.gap.servo.servo_parameters import INDEX, absent
from stiction_envs.hidden.examples import ANGLE, SHIPPED, TORQUE, log_csv
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.hidden.servo_logs import ENCODER, commands
from stiction_envs.hidden.servo_simulation import simulate
from stiction_envs.hidden.worlds import with_scattered_links
from stiction_envs.reporting.json_text import to_text
from stiction_envs.robots import load_arm
from tests.measured.logs.lerobot_datasets import SO101, write_calibration, write_dataset

SERVOS = {
    "stiffness": (11.3, 12.5, 11.0, 10.0, 11.3, 11.3),
    "damping": (0.62, 1.1, 0.5, 0.57, 0.51, 0.9),
    "stiction": (0.1, 0.05, 0.4, 0.15, 0.13, 0.1),
    "load": (0.0, 0.4, 0.0, 0.0, 0.0, 0.0),
}
"""Parameters of the servos by joint (`gap.servo.servo_parameters`), assumed: about those found of a
real arm (``benchmarks/servo/servo_friction.md``)."""
START = (0.0, -0.6, 0.7, 0.4, 0.0, 0.8)
"""Middle of the motion [rad]; assumed."""
INTERFACE = """# Beside so101.urdf: what it does not say.
[interface.controller_rate_hz] # of commands
value = 50.0
unit = "Hz"
source = "isaac-sim2real/sage: a real one was logged at 50 Hz through the bus of lerobot"
"""
RANGES = ((798, 3298), (910, 3186), (947, 3149), (967, 3129), (259, 3911), (2030, 3281))
"""Encoder steps of the calibrated ranges, of which zero is the middle; of the jaw, an end.
Assumed."""
FPS = 30
"""Rows per second, lerobot's default."""


def panda() -> tuple[dict[str, np.ndarray], str]:
    """Return the arrays of ``panda.npz``, and the truth."""
    options = {"motion": "fourier", "seconds": 26.0, "known": True, "size": 0.6, "second": 20.0}
    case = make_case(7, ("payload",), **options)  # type: ignore[arg-type]
    arrays = {}
    for name, (log,) in (("log", case.logs), ("other", case.second)):
        steps = np.round(log.q / ANGLE).astype(np.int32)
        arrays[f"{name}_q"] = np.diff(steps, axis=0, prepend=0)
        arrays[f"{name}_tau"] = np.round(log.tau / TORQUE).astype(np.int16)
    known = case.nominal
    truth = {
        "payload": case.hidden[0].values,
        "coulomb_friction": {"coulomb_nm": known.stiction[:, 0].tolist()},  # type: ignore[union-attr]
        "viscous_friction": {"viscous_nms": known.viscous[:, 0].tolist()},  # type: ignore[union-attr]
        "link_inertia": {"armature_kgm2": known.rotor_inertia.tolist()},  # type: ignore[union-attr]
    }
    return arrays, to_text(truth) + "\n"


def so101(folder: Path, *, seconds: tuple[float, float] = (90.0, 45.0)) -> None:
    """Write the files of ``so101.zip``: of a recording and another motion."""
    root = ET.parse(robot_file("so101")).getroot()
    for link in root.iter("link"):
        for what in ("visual", "collision"):
            for found in link.findall(what):
                link.remove(found)
    ET.indent(root)
    source = "<!-- SO-ARM100 of TheRobotStudio, Apache-2.0; without meshes -->\n"
    (folder / "so101.urdf").write_text(f"{source}{ET.tostring(root, encoding='unicode')}\n")
    (folder / "so101.toml").write_text(INTERFACE)
    arm = load_arm(folder / "so101.urdf")
    parameters = np.tile(absent(), (arm.n, 1))
    for name, values in SERVOS.items():
        parameters[:, INDEX[name]] = values
    rng = np.random.default_rng(101)
    real = with_scattered_links(arm, 0.05, rng)
    logs = []
    for length in seconds:
        t = np.arange(0.0, length, 1.0 / FPS)
        told = in_steps(commands(arm, t, rng, np.array(START)))
        logs.append((t, told, in_steps(simulate(real, parameters, t, told, told[0]))))
    (_, told, seen), (t, other_told, other) = logs
    write_dataset(folder / "recording", as_lerobot(seen), as_lerobot(told))
    shutil.rmtree(folder / "recording" / "videos")
    write_calibration(folder / "calibration.json", dict(zip(SO101, RANGES, strict=True)))
    (folder / "other.csv").write_text(log_csv(t, q_cmd=other_told, q=other))
    truth = {name: list(values) for name, values in SERVOS.items()}
    (folder / "hidden.json").write_text(to_text(truth) + "\n")


def in_steps(q: np.ndarray) -> np.ndarray:
    """Return angles (T, 6) in whole steps of the encoders, within the calibrated ranges [rad]."""
    low, high = np.array(RANGES, dtype=np.float64).T
    zero = (low + high) / 2
    zero[-1] = low[-1]
    return (np.clip(np.round(q / ENCODER + zero), low, high) - zero) * ENCODER


def as_lerobot(q: np.ndarray) -> np.ndarray:
    """Return angles as lerobot records them: degrees of 4095 steps a turn, the jaw 0 to 100."""
    steps = q / ENCODER
    out = steps * 360 / 4095
    out[:, -1] = 100 * steps[:, -1] / (RANGES[-1][1] - RANGES[-1][0])
    return out


def main() -> None:
    arrays, truth = panda()
    (SHIPPED / "panda.json").write_text(truth)
    with zipfile.ZipFile(SHIPPED / "panda.npz", "w", zipfile.ZIP_LZMA) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w") as file:
                np.save(file, np.asfortranarray(array))
    with tempfile.TemporaryDirectory() as place:
        so101(Path(place))
        with zipfile.ZipFile(SHIPPED / "so101.zip", "w", zipfile.ZIP_LZMA) as archive:
            for path in sorted(p for p in Path(place).rglob("*") if p.is_file()):
                archive.write(path, path.relative_to(place))


if __name__ == "__main__":
    main()
