"""Other people's arms and their logs: excited, identified, diagnosed; written models read again."""

import json
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.robots import load_arm
from tests.other_arms.arms import ARMS, Case, file_of

DIAGNOSED = ("double_pendulum", "kinova", "b1-z1")
REFUSED = {"baxter": "at rest the torque is 1.08 of what may be used of its limit"}
"""What `excite` says of arms that it finds no motion for: stretched out they cannot be held with a
margin, and in few other poses the hulls of their links are apart."""
EXCITED = ("ur5", "panda_collision", "talos_left_arm", "anymal-kinova")


@pytest.mark.parametrize("case", REFUSED, indirect=True)
def test_an_arm_without_room_for_a_motion_is_told_of_in_one_line(case: Case):
    ran = case.run("excite")
    assert ran.code == 1
    assert REFUSED[case.name] in ran.lines[-1]


@pytest.mark.slow
@pytest.mark.parametrize("case", EXCITED, indirect=True)
def test_an_arm_is_excited_and_identified_and_its_model_goes_back_in(case: Case):
    case.done("excite")
    case.done("identify")
    case.exports("identify")
    goes_back(case, "identify")


@pytest.mark.slow
@pytest.mark.parametrize("case", DIAGNOSED, indirect=True)
def test_a_diagnosis_says_what_was_hidden_and_its_models_go_back_in(case: Case):
    """The log has dry friction, which the rigid arm lacks; `--friction` takes what was found."""
    case.done("excite")
    case.done("diagnose")
    found = json.loads(Path("diagnose/diagnosis.json").read_text("utf-8"))
    assert "coulomb_friction" in [cause["name"] for cause in found["causes"]]
    provenance = json.loads(Path("diagnose/provenance.json").read_text("utf-8"))
    chain = ARMS[case.name][1]
    assert provenance["arguments"].get("chain") == (None if chain is None else list(chain))
    case.exports("diagnose")
    goes_back(case, "diagnose")
    one = ("--joint", 1, "--load", "no_load", "--direction", "+")
    case.done("sje", *one, "--friction", "diagnose/model.toml")
    assert "friction of this arm is assumed" not in Path("sje/report.md").read_text("utf-8")


def goes_back(case: Case, command: str) -> None:
    """A written model is read as the same arm: joints, limits, rest pose."""
    before = load_arm(file_of(case.name), chain=ARMS[case.name][1])
    after = load_arm(f"{command}/model.xml")
    assert after.joint_names == before.joint_names
    np.testing.assert_allclose(after.rest, before.rest, atol=1e-12)
    for name in ("position", "velocity", "torque"):
        np.testing.assert_allclose(
            getattr(after.limits, name), getattr(before.limits, name), err_msg=name
        )
