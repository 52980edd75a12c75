"""Pictures of joints: one figure serves all, and none shows what was drawn before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.report.figures import JointPictures
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm
from tests.gap.small_logs import hidden


def of_poses(two: Arm) -> JointLog:
    """The rows of a log as poses without time."""
    log = hidden(two)
    rows = slice(None, None, 30)
    t = np.arange(float(len(log.t[rows])))
    return replace(log, t=t, q=log.q[rows], tau=log.tau[rows], static=True)


@pytest.mark.parametrize("log", [hidden, of_poses])
def test_a_joint_is_drawn_alike_whatever_was_drawn_before(log, two: Arm, tmp_path: Path) -> None:
    found: Diagnosis = diagnose_logs([log(two)], two)
    pictures = JointPictures(found)
    for joint, path in ((0, "first.png"), (1, "again.png")):
        assert pictures.draw(joint, tmp_path / path).file == path
    JointPictures(found).draw(1, tmp_path / "alone.png")
    first, again, alone = (
        (tmp_path / f"{x}.png").read_bytes() for x in ("first", "again", "alone")
    )
    assert again == alone != first
