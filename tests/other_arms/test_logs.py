"""Other people's arms and their logs: excited, identified, diagnosed; written models read again."""

from __future__ import annotations

import json

import numpy as np
import pytest

from stiction_envs.robots import load_arm
from tests.other_arms.arms import ARMS, Case
from tests.other_arms.conftest import done

DIAGNOSED = ("double_pendulum", "kinova", "b1-z1")
REFUSED = {"baxter": "at rest the torque is 1.08 of what may be used of its limit"}
"""What `excite` says of arms that it finds no motion for: stretched out they cannot be held with a
margin, and in few other poses the hulls of their links are apart."""
EXCITED = ("ur5", "panda_collision", "talos_left_arm", "anymal-kinova")


@pytest.mark.parametrize("case", REFUSED, indirect=True)
def test_an_arm_without_room_for_a_motion_is_told_of_in_one_line(case: Case):
    came = case.run("excite")
    assert came.code == 1
    assert REFUSED[case.name] in came.said


@pytest.mark.slow
@pytest.mark.parametrize("case", EXCITED, indirect=True)
def test_each_arm_is_excited_and_identified_and_its_model_goes_back_in(case: Case):
    done(case, "excite")
    done(case, "identify")
    done(case, "export of identify's model.xml")
    goes_back(case, "identify")


@pytest.mark.slow
@pytest.mark.parametrize("case", DIAGNOSED, indirect=True)
def test_a_diagnosis_says_what_was_hidden_and_its_models_go_back_in(case: Case):
    """The log has dry friction, which the rigid arm lacks; `--friction` takes what was found."""
    done(case, "excite")
    done(case, "diagnose")
    found = json.loads(case.at("diagnose", "diagnosis.json").read_text("utf-8"))
    assert "coulomb_friction" in [cause["name"] for cause in found["causes"]]
    provenance = json.loads(case.at("diagnose", "provenance.json").read_text("utf-8"))
    chain = ARMS[case.name].chain
    assert provenance["arguments"].get("chain") == (None if chain is None else list(chain))
    done(case, "export of diagnose's model.xml")
    goes_back(case, "diagnose")
    done(case, "sje of the diagnosis", "--load", "no_load", "--direction", "+")
    report = case.at("sje_of_the_diagnosis", "report.md").read_text("utf-8")
    assert "friction of this arm is assumed" not in report


def goes_back(case: Case, command: str) -> None:
    """A written model is read as the same arm: joints, limits, rest pose."""
    robot, *chain = case.robot
    before = load_arm(robot, chain=chain[1:] or None)
    after = load_arm(case.at(command, "model.xml"))
    assert after.joint_names == before.joint_names
    np.testing.assert_allclose(after.rest, before.rest, atol=1e-12)
    for name in ("position", "velocity", "torque"):
        np.testing.assert_allclose(
            getattr(after.limits, name), getattr(before.limits, name), err_msg=name
        )
