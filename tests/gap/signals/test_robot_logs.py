"""Logs with a real robot's defects, all at once: their torques, and the signals made of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.torque_lag import correct_torques
from stiction_envs.measured.logs.reader import read_logs
from stiction_envs.robots import load_arm
from tests.measured.logs.robot_logs import excitation, sweeps

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


def test_torques_of_a_panda_are_in_order(tmp_path: Path) -> None:
    arm = load_arm("panda")
    logs = read_logs([excitation(tmp_path / "log.csv").path], arm.n, limits=arm.limits)
    (same,), _ = correct_torques(logs, arm, prepare)
    assert same is logs[0]


@pytest.mark.parametrize("made", ["panda", "clean", "iiwa"])
def test_speeds_and_accelerations_come_from_the_angles(tmp_path: Path, made: str) -> None:
    path = tmp_path / "log.csv"
    if made == "iiwa":
        sweeps(path, 2)
    else:
        excitation(path, defects=made == "panda")
    signals = prepare(read_logs([path], 7))
    assert 10 <= signals.cutoff_hz <= 40
    assert np.all(signals.noise_tau > 0)
    for segment in signals.segments:
        assert np.isfinite(segment.ddq).all()
        dq, ddq = (np.gradient(x, signals.dt, axis=0) for x in (segment.q, segment.dq))
        assert np.std(dq - segment.dq) < 0.02 * np.std(segment.dq)
        assert np.std(ddq - segment.ddq) < 0.1 * np.std(segment.ddq)
