"""The example recording is read as one of lerobot, of an arm that stops short."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.hidden import example_recording as example
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.servo_reader import read_servo_logs
from stiction_envs.robots import load_arm


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("example") / "new"
    example.write_recording(folder, seconds=20.0, second=12.0)
    return folder


def test_both_are_read_in_rad_without_a_warning(folder):
    arm = load_arm(folder / "so101.urdf")
    naming = Naming(joints=arm.joint_names, calibration=folder / "calibration.json")
    (recorded,) = read_servo_logs([folder / "recording"], 6, limits=arm.limits, naming=naming)
    (other,) = read_servo_logs([folder / "other.csv"], 6, limits=arm.limits)
    for log, rows in ((recorded, 600), (other, 360)):
        assert len(log.t) == rows
        assert not log.warnings
        assert np.ptp(log.q_cmd, axis=0).min() > 0.2
        steps = log.q / example.ENCODER
        if log is recorded:
            steps[:, :5] *= 4095 / 4096  # lerobot counts 4095 steps a turn
        # halves: of ranges with an odd number of steps the middle is between two
        np.testing.assert_allclose(2 * steps, np.round(2 * steps), atol=2e-2)


def test_the_arm_stops_short_and_comes_at_its_rate(folder):
    arm = load_arm(folder / "so101.urdf")
    assert arm.controller_rate_hz == 50
    (other,) = read_servo_logs([folder / "other.csv"], 6, limits=arm.limits)
    off = np.abs(other.q - other.q_cmd).mean(axis=0)
    assert (off > 2 * example.ENCODER).all()
    truth = json.loads((folder / "hidden.json").read_text("utf-8"))
    assert truth["stiction"] == list(example.SO101["stiction"])


def test_the_robot_has_no_meshes_and_the_same_masses(folder):
    text = (folder / "so101.urdf").read_text("utf-8")
    assert "mesh" not in text
    assert str(Path.home()) not in text
    assert text.count("<inertial>") >= 7


def test_a_folder_that_is_there_is_kept(folder, capsys):
    before = sorted(folder.rglob("*"))
    assert example.main([str(folder)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert sorted(folder.rglob("*")) == before


def test_without_the_arms_package_it_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(example, "URDF", "nowhere/so101.urdf")
    with pytest.raises(StictionError, match="expected the package example-robot-data"):
        example.write_recording(tmp_path / "new")
    assert not (tmp_path / "new").exists()
