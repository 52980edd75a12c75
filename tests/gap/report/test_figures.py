"""Pictures of joints of servo logs with contact."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from stiction_envs.gap.report.figures import draw_joint
from stiction_envs.gap.report.series import Series
from stiction_envs.gap.report.servo_result import ServoResult


def drawn(s: Series, joint: int, plots: Path) -> bytes:
    plots.mkdir(exist_ok=True)
    text = draw_joint(s, joint, plots)
    assert text.startswith(f"![joint {joint + 1}](plots/joint_{joint + 1}.png)")
    return (plots / f"joint_{joint + 1}.png").read_bytes()


def test_the_residual_leaves_out_contact_and_the_caption_says_so(
    tmp_path: Path, angles: ServoResult
) -> None:
    s = angles.series()
    free = replace(s, contact=np.zeros(len(s.time), dtype=bool))
    assert drawn(s, 1, tmp_path) != drawn(free, 1, tmp_path)
    assert "without contact" in draw_joint(s, 1, tmp_path)
    assert "contact" not in draw_joint(free, 1, tmp_path)
