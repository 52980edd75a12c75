"""SAGE's folders, and the message on files of PyTorch."""

import csv
from functools import partial
from itertools import repeat
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.checks.files import check
from stiction_envs.measured.logs.reader import drive_of
from tests.measured.logs.bad_logs import LFS_POINTER, refuses, servo_log, torque_log
from tests.measured.logs.lerobot_datasets import SO101, TICK, write_calibration
from tests.measured.logs.test_lerobot import ANGLES, COMMAND, ROWS

TIME = np.arange(ROWS) * 0.02006
JAW = 1523


def write_lists(path: Path, names: str, t: np.ndarray, *lists: np.ndarray) -> None:
    with open(path, "w", newline="") as file:
        rows = zip(repeat("KIND"), 1e6 * t, *(x.tolist() for x in lists))
        csv.writer(file).writerows([("type", "timestamp", *names.split()), *rows])


def write_sage(
    folder: Path,
    t: np.ndarray,
    command: np.ndarray,
    q: np.ndarray,
    torque: np.ndarray,
    *,
    early: float = 0.0,
    names: tuple[str, ...] = SO101,
) -> Path:
    """Write a folder; commands come ``early`` [s]."""
    folder.mkdir(parents=True)
    write_lists(folder / "control.csv", "positions", t - early, command)
    state = "positions velocities torques"
    write_lists(folder / "state_motor.csv", state, t, q, 1000 * q, torque)
    (folder / "event.csv").write_text("type,timestamp,event\r\nEVENT,0,MOTION_START\r\n")
    (folder / "joint_list.txt").write_text("\n".join(names) + "\n")
    return folder


def shares(q: np.ndarray) -> np.ndarray:
    """Return angles with the jaw as a share of its range."""
    return np.column_stack([q[:, :5], np.clip(q[:, 5] / (JAW * TICK), 0, 1)])


def current() -> np.ndarray:
    return 0.022814 * np.round(np.maximum(20 * np.sin(3 * TIME)[:, None] + np.arange(6), 0))


def so101(folder: Path, **options) -> Path:
    return write_sage(folder, TIME, shares(COMMAND), shares(ANGLES), current(), **options)


read = partial(servo_log, n=6)


def test_two_files_become_one_log(tmp_path: Path) -> None:
    path = so101(tmp_path / "motion")
    assert drive_of(path) == "position"
    log = read(path)
    assert log.t == pytest.approx(TIME, abs=1e-9)
    assert log.q == pytest.approx(ANGLES, abs=1e-9)
    assert log.q_cmd == pytest.approx(COMMAND, abs=1e-9)
    assert log.current == pytest.approx(current())
    assert (log.tau, log.dq) == (None, None)
    assert log.warnings == ("columns not used: 'velocities'",)
    what, jaw = (c.text for c in log.corrections)
    assert what.endswith("gripper; torques have no sign: sizes of currents")
    assert jaw == "gripper: 1 are a range of 1523 encoder steps, from the smallest step"
    assert check(path).defects == ()
    told = write_calibration(tmp_path / "arm.json")
    assert read(path, calibration=told).q == pytest.approx(log.q)


def test_commands_hold_until_the_next(tmp_path: Path) -> None:
    log = read(so101(tmp_path / "motion", early=-0.005))
    assert len(log.t) == ROWS - 1
    assert log.q_cmd == pytest.approx(COMMAND[:-1], abs=1e-9)
    assert log.q == pytest.approx(ANGLES[1:], abs=1e-9)


def test_signed_torques_are_torques(tmp_path: Path) -> None:
    names = tuple(f"left_{x}_joint" for x in ("hip", "knee", "ankle", "waist", "arm", "hand"))
    torque = np.sin(ANGLES) + 0.01 * np.random.default_rng(0).normal(size=ANGLES.shape)
    path = write_sage(tmp_path / "motion", TIME, COMMAND, ANGLES, torque, names=names)
    assert drive_of(path) == "torque"
    log = torque_log(path, 6)
    # it rests at first, which the reader of joint logs takes for angles that are late
    assert log.tau[1:] == pytest.approx(torque[3:])
    assert len(log.t) == ROWS - 2
    assert read(path).tau == pytest.approx(torque)
    assert read(path, n=2, joints=(names[3], names[0])).q == pytest.approx(ANGLES[:, [3, 0]])
    path = so101(tmp_path / "other")
    refuses(lambda: torque_log(path, 6), "no torques with a sign: expected drive position")


HEAD = "type,timestamp,positions\n"
DAMAGES = {
    "no rows": ("state_motor.csv", HEAD),
    "line 2: no time": ("control.csv", HEAD + 'C,x,"[1]"\n'),
    "commands of 1 joint": ("control.csv", HEAD + 'C,0,"[1]"\n'),
    "line 3: positions of other joints": ("control.csv", HEAD + 'C,0,"[1]"\nC,1,"[1, 2]"\n'),
    "2 names: expected those of 6": ("joint_list.txt", "a\nb\n"),
    "control.csv: a pointer of Git LFS .* run `git lfs pull`": ("control.csv", LFS_POINTER),
}


@pytest.mark.parametrize("says", DAMAGES)
def test_a_damaged_folder_is_one_clear_line(tmp_path: Path, says: str) -> None:
    path = so101(tmp_path / "motion")
    name, text = DAMAGES[says]
    (path / name).write_text(text)
    refuses(lambda: read(path), says)


def test_pickles_are_refused_and_not_opened(tmp_path: Path) -> None:
    path = tmp_path / "chirp_data.pt"
    path.write_bytes(b"\x80\x02cos\nsystem\n(S'touch opened'\ntR.")
    text = refuses(lambda: drive_of(path), "a pickle, which can run code: expected .npz")
    assert "numpy.savez('log.npz', t=d['time'], q=d['dof_pos'], q_cmd=d['des_dof_pos'])" in text
    (found,) = check(path).findings
    assert text == f"{path}: {found.message}"
    assert ".pt" not in refuses(lambda: drive_of(Path(__file__)), "unknown kind of file: expected")
