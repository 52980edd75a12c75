"""Logs of real robots, and logs made with all their defects: torques and signals made of them."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.torque_lag import correct_torques
from stiction_envs.measured.logs.reader import read_logs
from stiction_envs.robots import load_arm
from tests.measured.logs.robot_logs import excitation, real, sweeps

PANDA = "panda_exciting_trajectory/panda_exciting_trajectory.csv.gz"
IIWA = load_arm("iiwa14")


@pytest.mark.parametrize(
    ("joint", "sign", "lag", "found"),
    [
        (2, -1.0, 0.12, ["run", "sign", "lag"]),  # gravity tells
        (7, -1.0, 0.12, ["run", "sign", "lag"]),  # friction tells
        (1, -1.0, 0.0, ["run", "sign"]),
        (3, 1.0, 0.0, ["run"]),
    ],
)
def test_torques_of_an_iiwa_are_turned_and_brought_forward(
    tmp_path: Path, joint: int, sign: float, lag: float, found: list[str]
) -> None:
    logs = read_logs([sweeps(tmp_path / "joint.csv", joint, sign=sign, lag=lag)], IIWA.n)
    (log,), _ = correct_torques(logs, IIWA, prepare)
    assert [c.kind for c in log.corrections] == found
    assert len(log.segments) == 8
    right = sweeps(tmp_path / "right.csv", joint, sign=1.0, lag=0.0)
    (truth,) = read_logs([right], IIWA.n)
    for here, there in zip(log.segments, truth.segments, strict=True):
        seen, true = log.tau[here][200:-200, joint - 1], truth.tau[there][200:, joint - 1]
        assert np.std(seen - true[: len(seen)]) < 0.1 * np.std(true)


@pytest.mark.parametrize(
    ("joint", "found"), [(2, ["sign", "lag"]), (7, ["sign", "lag"]), (3, ["sign"]), (1, ["sign"])]
)
def test_what_the_iiwas_readme_says_of_its_torques(joint: int, found: list[str]) -> None:
    """Opposite sign, and channels that are not aligned in time; two joints' sweeps show no lag."""
    path = real(f"iiwa14_joint_friction/joint{joint}.csv.gz")
    (log,) = read_logs([path], IIWA.n, limits=IIWA.limits)
    (corrected,), _ = correct_torques([log], IIWA, partial(prepare, most_samples=40_000))
    assert [c.kind for c in corrected.corrections if c.kind != "run"] == found
    assert len(corrected.segments) == len(log.segments)


@pytest.mark.parametrize("is_real", [False, True])
def test_torques_of_a_panda_are_in_order(tmp_path: Path, is_real: bool) -> None:
    path = real(PANDA) if is_real else excitation(tmp_path / "log.csv").path
    arm = load_arm("panda")
    logs = read_logs([path], arm.n, limits=arm.limits)
    (same,), _ = correct_torques(logs, arm, prepare)
    assert same is logs[0]
