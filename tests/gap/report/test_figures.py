"""Pictures of joints: of logs, of poses without time, of servo logs with contact."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.gap.report.figures import draw_errors, draw_joint
from stiction_envs.gap.report.log_result import LogDiagnosis
from stiction_envs.gap.report.page import Errors
from stiction_envs.gap.report.series import Series
from stiction_envs.gap.report.servo_result import ServoResult


def as_poses(s: Series) -> Series:
    return replace(s, time=np.arange(float(len(s.time))), at_rest=True)


def test_a_joint_is_drawn_alike_each_time_and_another_one_is_not(
    tmp_path: Path, torques: LogDiagnosis
) -> None:
    s = torques.series()
    drawn = [tmp_path / f"{k}.png" for k in range(3)]
    for path, joint in zip(drawn, (0, 0, 1), strict=True):
        assert draw_joint(s, joint, path).startswith(f"Joint {joint + 1}: ")
    first, again, other = (path.read_bytes() for path in drawn)
    assert first == again != other


def test_poses_are_dots_over_their_number(tmp_path: Path, torques: LogDiagnosis) -> None:
    draw_joint(torques.series(), 0, tmp_path / "log.png")
    draw_joint(as_poses(torques.series()), 0, tmp_path / "poses.png")
    assert (tmp_path / "log.png").read_bytes() != (tmp_path / "poses.png").read_bytes()


def test_the_residual_leaves_out_contact_and_the_caption_says_so(
    tmp_path: Path, angles: ServoResult
) -> None:
    s = angles.series()
    assert "without contact" in draw_joint(s, 1, tmp_path / "with.png")
    free = replace(s, contact=np.zeros(len(s.time), dtype=bool))
    assert "contact" not in draw_joint(free, 1, tmp_path / "without.png")
    assert (tmp_path / "with.png").read_bytes() != (tmp_path / "without.png").read_bytes()


@pytest.mark.parametrize("noise", [None, np.array([0.1, 0.2])])
def test_errors_of_two_kinds_have_a_panel_each(tmp_path: Path, noise: np.ndarray | None) -> None:
    one = Errors(
        what="Held out",
        unit="rad",
        joints=(1, 5),
        nominal=np.array([1.0, 2.0]),
        extended=np.array([0.5, 0.3]),
        noise=noise,
    )
    path = tmp_path / "errors.png"
    assert draw_errors([one, replace(one, what="in a check", unit="N·m")], path) == (
        "Held out; in a check."
    )
    assert path.is_file()
