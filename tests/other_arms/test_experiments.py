"""Other people's arms in experiments: each breaks a joint away; the longer commands take turns."""

from pathlib import Path

import pytest

from stiction_envs.robots import load_arm
from tests.command_line import csv_rows
from tests.other_arms.arms import ARMS, Case, file_of

ONE = ("--joint", 1, "--load", "no_load", "--direction", "+")
TURNS = {"double_pendulum": "tune", "kinova": "gte", "b1-z1": "conformance"}
"""`tune` measures every joint in both poses and both directions: only the smallest arm's."""


@pytest.mark.slow
@pytest.mark.parametrize("case", ARMS, indirect=True)
def test_each_arm_is_exported_and_breaks_away_and_the_longer_commands_take_turns(case: Case):
    case.done("export")
    case.exports("export")
    case.done("sje", *ONE)
    (row,) = csv_rows(Path("sje/sje.csv"))
    assert float(row["tau_nm"]) > 0
    report = Path("sje/report.md").read_text("utf-8")
    stated = load_arm(file_of(case.name), chain=ARMS[case.name][1]).stated.dry
    assumed = report.split("\n\n")[1].startswith("> **The friction of this arm is assumed")
    assert assumed == (not stated)
    if case.name in TURNS:
        case.done(TURNS[case.name])


@pytest.mark.parametrize("case", ["talos_left_arm"], indirect=True)
def test_a_gripper_that_counts_as_a_joint_is_brought_to_its_pose(case: Case):
    """Joint 7, the gripper, has a torque limit of 1 N·m, which its friction takes all of."""
    case.done("sje", "--joint", 6, *ONE[2:])


@pytest.mark.parametrize("command", ["export", "sje", "excite", "conformance"])
def test_a_bigger_robot_without_a_chain_is_told_of_in_one_line(refused, command: str):
    line = refused(command, file_of("baxter"), "--out", "out")
    if command != "conformance":  # it tests every hinge of a file as it is
        assert "; of a bigger robot take one arm: chain " in line


def test_the_line_names_chains_that_work(cli):
    said = cli("export", file_of("baxter"), "--out", "a").err
    chain = said.split("take one arm: chain ")[1].split(" (or ")[0].split()
    assert cli("export", file_of("baxter"), "--chain", *chain, "--out", "b").code == 0
    assert chain == ["right_arm_mount", "right_wrist"]
