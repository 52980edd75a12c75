"""The page to read before a diagnosis: what a log is, and what its motion can show."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.gap.overview import Overview, overview
from stiction_envs.robots import load_arm
from tests.gap.small_logs import dry, hidden, panda


@pytest.fixture(scope="module")
def good() -> Overview:
    return overview(hidden(panda(), dry), panda())


def test_a_good_log_in_one_screen(good: Overview) -> None:
    assert good.findings == []
    assert good.rate_hz == pytest.approx(200)
    assert good.effective_rate_hz == pytest.approx(200)
    for factor, (low, high) in zip(good.factor, good.factor_ci95, strict=True):
        assert low < 1 < high or abs(factor - 1) < 0.02
    lines = str(good).splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 200
    assert lines[0].startswith("made.csv: 3000 rows, 15.0 s, 200 rows/s")
    assert "cutoff" in lines[1]


def test_what_a_motion_shows_is_known_better_than_before(good: Overview) -> None:
    """Joint 1 of an upright arm carries no weight: its zero shows nowhere."""
    assert max(good.left["coulomb_friction"]) < 0.1
    assert good.left["encoder_offset"][0] == 1.0
    assert good.left["encoder_offset"][1] < 0.2
    assert good.left["payload"][0] < 0.2


def test_a_joint_that_rests_shows_no_friction() -> None:
    log = hidden(panda(), dry)
    q = np.array(log.q)
    q[:, 4] = q[0, 4]
    found = overview(dataclasses.replace(log, q=q), panda())
    assert found.about[4].startswith("rests")
    assert found.left["viscous_friction"][4] > 0.9


def test_joints_that_move_together_and_torques_that_are_opposite() -> None:
    log = hidden(panda(), dry)
    q = np.array(log.q)
    q[:, 3] = q[:, 1] - 1.5
    found = overview(dataclasses.replace(log, q=q), panda())
    assert "moves with joint 4" in found.about[1]
    turned = overview(dataclasses.replace(log, tau=-log.tau), panda())
    assert [kind for kind, _ in turned.findings] == ["corrected"]
    assert turned.about[0] == "opposite sign"
    assert turned.factor[1] == pytest.approx(-1, abs=0.02)


def test_a_body_that_the_model_lacks_is_a_remark() -> None:
    log = hidden(panda(), dry, true=load_arm("panda", payload=(3.0, 0.0, 0.0, 0.05)))
    ((kind, text),) = overview(log, panda()).findings
    assert kind == "remark"
    assert "times what the model needs" in text
