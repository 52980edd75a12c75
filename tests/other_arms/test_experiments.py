"""Other people's arms in experiments: each breaks a joint away; the longer commands take turns."""

from __future__ import annotations

import csv

import pytest

from tests.other_arms.arms import ARMS, Case, folder, run
from tests.other_arms.conftest import done

ONE = ("--joint", 1, "--load", "no_load", "--direction", "+")
TUNED = "double_pendulum"
"""`tune` measures every joint in both poses and both directions: only the smallest arm's."""
TURNS = {
    name: "tune" if name == TUNED else ("gte", "conformance")[k % 2] for k, name in enumerate(ARMS)
}


@pytest.mark.slow
@pytest.mark.parametrize("case", ARMS, indirect=True)
def test_each_arm_is_exported_and_breaks_away(case: Case):
    done(case, "export")
    done(case, "export of export's model.xml")
    done(case, "sje", *ONE)
    with open(case.at("sje", "sje.csv"), encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert float(row["tau_nm"]) > 0
    report = case.at("sje", "report.md").read_text("utf-8")
    assert report.split("\n\n")[1].startswith("> **The friction of this arm is assumed")


@pytest.mark.parametrize("case", ["talos_left_arm"], indirect=True)
def test_a_gripper_that_counts_as_a_joint_is_brought_to_its_pose(case: Case):
    """Joint 7 has a torque limit of 1 N·m, the friction that is assumed takes half of it."""
    done(case, "sje", "--joint", 7, *ONE[2:])


@pytest.mark.slow
@pytest.mark.parametrize("case", ARMS, indirect=True)
def test_the_longer_commands_take_turns(case: Case):
    if TURNS[case.name] == "conformance":
        done(case, "export")
    done(case, TURNS[case.name])


@pytest.mark.parametrize("name", ["anymal-kinova", "baxter"])
@pytest.mark.parametrize("command", ["export", "sje", "excite", "conformance"])
def test_a_bigger_robot_without_a_chain_is_told_of_in_one_line(name: str, command: str, tmp_path):
    out = tmp_path / "out"
    argv = [command, folder() / ARMS[name].file, "--out", out]
    came = run(argv)
    assert came.code == 2
    assert not out.exists()
    if command != "conformance":  # it tests every hinge of a file as it is
        assert "; of a bigger robot take one arm: chain " in came.said


def test_the_line_names_chains_that_work(tmp_path):
    came = run(["export", folder() / ARMS["baxter"].file, "--out", tmp_path / "a"])
    base, tip = came.said.split("take one arm: chain ")[1].split(" (or ")[0].split()
    again = run(
        ["export", folder() / ARMS["baxter"].file, "--chain", base, tip, "--out", tmp_path / "b"]
    )
    assert again.code == 0
    assert (base, tip) == ("right_arm_mount", "right_wrist")
