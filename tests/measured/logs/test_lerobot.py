"""Datasets of lerobot: what is read, and in which unit."""

import json
import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.checks.files import check
from stiction_envs.measured.logs.log_files import count_joints
from stiction_envs.measured.logs.reader import drive_of
from stiction_envs.measured.logs.units import read_calibration
from stiction_envs.reporting.provenance import sha256
from tests.measured.logs.bad_logs import LFS_POINTER, put, refuses, servo_log, torque_log
from tests.measured.logs.lerobot_datasets import (
    SO101,
    TICK,
    in_ticks,
    normalised,
    write_calibration,
    write_dataset,
    zero,
)
from tests.refusal import refusal

N, FPS = 6, 30
ROWS = 600


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Commanded angles, and angles in whole encoder steps that stay behind them, (T, 6) rad."""
    t = np.arange(ROWS) / FPS
    middle = np.array([0, 0.2, -0.1, 0.3, 0, 1.0])
    command = middle + 0.6 * np.sin(np.outer(t, 1 + 0.3 * np.arange(N)))
    q = np.roll(command, 2, axis=0)
    q[:2] = command[0]
    ticks = in_ticks(q)
    return command, (ticks - [zero(name) for name in SO101]) * TICK


COMMAND, ANGLES = motion()


def dataset(folder: Path, degrees: bool, **options) -> Path:
    ticks = in_ticks(ANGLES)
    exact = COMMAND / TICK + [zero(name) for name in SO101]
    state, action = (normalised(x, degrees) for x in (ticks, exact))
    return write_dataset(folder, state, action, fps=FPS, **options)


read = partial(servo_log, n=N)


@pytest.mark.parametrize("version", ["v3.0", "v2.1"])
def test_percent_becomes_radians_by_the_encoders_steps(tmp_path: Path, version: str) -> None:
    path = dataset(tmp_path / "set", False, version=version, episodes=(200, 400))
    assert drive_of(path) == "position"
    assert count_joints(path) == N
    log = read(path)
    # the range is known to a step
    assert log.q == pytest.approx(ANGLES, abs=0.6 * TICK)
    assert log.q_cmd == pytest.approx(COMMAND, abs=0.6 * TICK)
    assert log.breaks == (200,)
    assert log.step == pytest.approx(1 / FPS)
    assert (log.tau, log.dq, log.current, log.warnings) == (None, None, None, ())
    how, unit, runs = (c.text for c in log.corrections)
    assert "joints 1 to 6 are shoulder_pan" in how
    assert "times are frames at 30 Hz, not measured" in how
    assert unit.startswith("angles are in percent (they come in other steps for each joint")
    assert "shoulder_pan: 200 are a range of 2640 encoder steps, from the smallest step" in unit
    assert "gripper: 100 are a range of 1523 encoder steps" in unit
    assert runs.startswith("2 recordings in one file")


def test_percent_by_the_calibration_file(tmp_path: Path) -> None:
    """Joints that hardly move show no step; the file tells."""
    ticks = in_ticks(ANGLES)
    ticks[:, 2] = ticks[0, 2]
    path = write_dataset(tmp_path / "set", normalised(ticks, False), normalised(ticks, False))
    says = "elbow_flex is in percent of its calibrated range"
    refuses(lambda: read(path, units="percent"), says)
    log = read(path, units="percent", calibration=write_calibration(tmp_path / "arm.json"))
    at = (ticks[0, 2] - zero("elbow_flex")) * TICK
    assert log.q[:, 2] == pytest.approx(at, abs=1e-6)
    assert log.q[:, :2] == pytest.approx(ANGLES[:, :2], abs=1e-6)
    assert "2640 encoder steps, from the calibration" in log.corrections[1].text


def test_degrees_are_recognised_and_the_gripper_is_not_in_degrees(tmp_path: Path) -> None:
    log = read(dataset(tmp_path / "set", True))
    assert log.q == pytest.approx(ANGLES, abs=0.6 * TICK)
    assert log.q_cmd == pytest.approx(COMMAND, abs=0.6 * TICK)
    unit = log.corrections[1].text
    assert unit.startswith("angles are in deg (they come in steps of 0.08791")
    assert "gripper: 100 are a range of 1523" in unit
    assert read(tmp_path / "set", units="deg").q == pytest.approx(log.q)


def test_units_that_nothing_shows_are_asked_for(tmp_path: Path) -> None:
    """Small angles without steps: degrees, percent or radians."""
    path = write_dataset(tmp_path / "set", COMMAND, COMMAND + 0.01)
    refuses(lambda: read(path), r"may be degrees, .*: expected units deg, percent")
    (found,) = check(path).findings
    assert found.kind == "unreadable"
    assert check(path, units="rad").defects == ()
    assert read(path, units="rad").q == pytest.approx(COMMAND, abs=1e-6)
    assert "angles are in rad (as asked)" in read(path, units="rad").corrections[1].text
    refuses(lambda: read(path, units="turns"), "units")
    big = write_dataset(tmp_path / "big", 300 * COMMAND, 300 * COMMAND, robot=None)
    log = servo_log(big, 5, joints=SO101[:5])
    assert "angles are in deg (they reach" in log.corrections[1].text
    assert log.q == pytest.approx(np.radians(300 * COMMAND[:, :5]), rel=1e-4, abs=1e-4)


def test_torques_of_an_openarm(tmp_path: Path) -> None:
    """Angles are in degrees; state and action have speeds and torques between the angles."""
    motors = ("joint_1", "joint_2", "gripper")
    names = tuple(f"{m}.{c}" for m in motors for c in ("pos", "vel", "torque"))
    t = np.arange(ROWS) / FPS
    q = 0.5 * np.sin(np.outer(t, [1.0, 1.3, 0.7]))
    dq = np.gradient(q, t, axis=0)
    tau = q + 0.1 * np.sign(dq)
    state = np.stack([np.degrees(q), np.degrees(dq), tau], axis=2).reshape(len(t), -1)
    path = write_dataset(tmp_path / "set", state, state, names=names, robot="openarm_follower")
    assert drive_of(path) == "torque"
    log = torque_log(path, 2)
    assert log.q == pytest.approx(q[:, :2], abs=1e-5)
    assert log.dq == pytest.approx(dq[:, :2], abs=1e-5)
    assert log.tau == pytest.approx(tau[:, :2], abs=1e-5)
    servo = servo_log(path, 3)
    assert servo.q_cmd == pytest.approx(q, abs=1e-5)
    assert servo.tau == pytest.approx(tau, abs=1e-5)
    assert "(robot_type is 'openarm_follower')" in servo.corrections[1].text


def test_joints_by_the_names_of_the_robot(tmp_path: Path) -> None:
    path = dataset(tmp_path / "set", False)
    log = servo_log(path, 2, robot=("wrist_flex", "elbow_flex"))
    assert log.q == pytest.approx(ANGLES[:, [3, 2]], abs=0.6 * TICK)
    refuses(lambda: servo_log(path, 5), r"its joints are .*name the joints")
    refuses(lambda: servo_log(path, 2, joints=("elbow", "wrist_flex")), "elbow")
    refusal(lambda: read(path, topic="/a"), "topic")


def test_provenance_knows_the_numbers_and_not_the_films(tmp_path: Path) -> None:
    path = dataset(tmp_path / "set", False)
    before = sha256(path)
    (path / "videos" / "file-000.mp4").write_bytes(b"another film")
    assert sha256(path) == before
    data = path / "data" / "chunk-000" / "file-000.parquet"
    data.write_bytes(data.read_bytes() + b" ")
    assert sha256(path) != before


def text_in(name: str, text: str) -> Callable[[Path], object]:
    return lambda path: put(path / name, text)


def info(change: Callable[[dict], object]) -> Callable[[Path], object]:
    def damage(path: Path) -> None:
        values = json.loads((path / "meta/info.json").read_text())
        change(values)
        (path / "meta/info.json").write_text(json.dumps(values))

    return damage


def state(**values: object) -> Callable[[Path], object]:
    return info(lambda v: v["features"]["observation.state"].update(values))


DAMAGES = {
    r"set/meta/info\.json: damaged or no info\.json": text_in("meta/info.json", "{"),
    "fps is 0: expected": info(lambda v: v.update(fps=0)),
    "info.json: 'observation.state' has 6 names for 7 columns: expected one each": state(shape=[7]),
    "file-000.parquet: a pointer of Git LFS .* run `git lfs pull`": (
        text_in("data/chunk-000/file-000.parquet", LFS_POINTER)
    ),
    "'a.pos' is there twice": state(names=["a.pos"] * 6),
    "damaged, or not as info.json says": state(shape=[2], names=["a", "b"]),
    r"no \.parquet in data/": lambda path: shutil.rmtree(path / "data"),
}


@pytest.mark.parametrize("says", DAMAGES)
def test_a_damaged_dataset_is_one_clear_line(tmp_path: Path, says: str) -> None:
    path = dataset(tmp_path / "set", False)
    DAMAGES[says](path)
    refuses(lambda: servo_log(path, 2 if "not as" in says else N), says)
    (found,) = check(path).findings
    assert re.search(says, found.message)


@pytest.mark.parametrize("text", ["", "{}", '{"a": {"id": 1, "range_min": 5, "range_max": 5}}'])
def test_a_damaged_calibration_is_one_clear_line(tmp_path: Path, text: str) -> None:
    path = put(tmp_path / "arm.json", text)
    refuses(lambda: read_calibration(path), r"arm\.json.*expected lerobot's JSON")
    other = write_calibration(tmp_path / "other.json", {"a": (0, 4095)})
    path = dataset(tmp_path / "set", False)
    says = "has no motor 'shoulder_pan': expected one of a"
    refuses(lambda: read(path, calibration=other), says)
