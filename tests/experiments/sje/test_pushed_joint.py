"""A pushed joint holds, then breaks away; with dither it breaks away earlier."""

import numpy as np
import pytest

from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.pushed_joint import PushedJoint
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.measured.tables import AmplitudeRow


@pytest.fixture(scope="module")
def panda():
    return sticking_model("panda")


@pytest.fixture
def push(panda):
    return PushedJoint(panda, dither=thesis_final_dither())


def share_of_stiction(push: PushedJoint, sign: float, share: float) -> float:
    """Return the push [N·m] that loads the friction with a share of its stiction."""
    offset = float(push.plant.offset[0, push.joint - 1])
    return offset + share * (sign * push.holds_up_to(sign) - offset)


@pytest.mark.parametrize(("joint", "sign"), [(4, -1), (7, 1)])
def test_a_joint_holds_at_90_percent_and_goes_at_115(push, joint, sign):
    push.choose(joint)
    push.target = share_of_stiction(push, sign, 0.9)
    push.advance(24.0)
    assert push.let_go is None
    assert push.torque == push.target
    assert abs(push.angle) < 0.004, "it gives way by its bristle, and stands"
    held = push.angle
    push.advance(2.0)
    assert abs(push.angle - held) < 1e-4
    push.target = share_of_stiction(push, sign, 1.15)
    push.advance(24.0)
    assert push.let_go is not None
    assert sign * (push.let_go - share_of_stiction(push, sign, 0.9)) > 0
    assert push.torque == push.target == 0.0, "the push is over"


@pytest.mark.parametrize("joint", [2, 7])
def test_dither_lets_go_what_holds_at_90_percent(push, joint):
    push.choose(joint)
    push.harder(9)
    push.advance(20.0)
    assert push.let_go is None
    held = push.torque
    push.switch_dither()
    push.advance(8.0)
    assert push.let_go == held
    assert not push.slips, "friction has stopped it"


def test_it_is_pushed_from_where_it_came_to_rest_and_reset_brings_it_back(push):
    rest = push.plant.position.copy()
    push.choose(7)
    push.harder(12)
    push.advance(30.0)
    assert push.let_go is not None
    assert abs(push.angle) < 1e-3
    push.reset()
    assert np.array_equal(push.plant.position, rest)
    assert (push.joint, push.torque, push.let_go) == (7, 0.0, None)


def test_a_slow_controller_holds_its_torque():
    iiwa = PushedJoint(sticking_model("iiwa7"), dither=[AmplitudeRow(7, 20.0, 1.0)])
    assert iiwa.interface.hold_steps > 1
    assert iiwa.block % iiwa.interface.hold_steps == 0
    iiwa.choose(7)
    iiwa.harder(9)
    iiwa.advance(24.0)
    held = iiwa.angle
    assert abs(held) < 0.02
    iiwa.switch_dither()
    iiwa.advance(8.0)
    assert iiwa.angle - held > 0.05, "its viscous friction lets it go slowly"
