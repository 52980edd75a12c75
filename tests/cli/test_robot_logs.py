"""Logs as robots write them, on the command line: the same result as that of a CSV of ours."""

import json
import sys

import numpy as np
import pytest

from stiction_envs.robots import load_arm
from tests.gap.small_logs import hidden, sliding, write_csv
from tests.measured.logs.bad_logs import good_values
from tests.measured.logs.robot_csv import libfranka
from tests.measured.logs.ros_bags import joint_states, merged, write_bag


@pytest.fixture
def csv(two, inputs):
    """A log of the small arm with dry friction."""
    path = inputs / "log.csv"
    write_csv(path, hidden(load_arm(two), lambda q, dq, ddq: 0.5 * sliding(q)))
    return path


@pytest.fixture
def values(csv):
    """Its numbers, t, q, dq, tau, as the text rounds them."""
    t, q, tau = np.split(np.loadtxt(csv, delimiter=",", skiprows=1), [1, 3], axis=1)
    return np.column_stack([t, q, np.gradient(q, t[:, 0], axis=0), tau])


@pytest.fixture
def bag(values, inputs):
    """The same as ROS 2 records it, joints by names that only have the same numbers."""
    states = joint_states(values, ("my_joint1", "my_joint2"), speeds=False)
    return write_bag(inputs / "bag", "folder", states)


@pytest.mark.slow
def test_diagnose_and_identify_a_bag(cli, two, csv, bag, work):
    for command, name in (("diagnose", "diagnosis"), ("identify", "identification")):
        found = {}
        for log in (csv, bag):
            ran = cli(
                command, log, "--robot", two, "--torque", "link", "--out", log.name, "--force"
            )
            assert ran.code == 0, ran.err
            found[log.name] = json.loads((work / log.name / f"{name}.json").read_text())
        a, b = (found[log.name] for log in (csv, bag))
        shown = ("causes", "extended", "nominal", "verdict", "links", "friction")
        assert {k: a[k] for k in shown if k in a} == {k: b[k] for k in shown if k in b}
        made = json.loads((work / bag.name / "provenance.json").read_text())
        assert len(made["inputs"]["log1"]["sha256"]) == 64
    assert "my_joint1, my_joint2" in (work / "bag/report.md").read_text()


def test_check_says_what_a_log_is(cli, inputs):
    path = inputs / "log.csv"
    path.write_text(libfranka(good_values()))
    ran = cli("check", path, "--robot", "panda", "--json")
    assert ran.code == 0, ran.err
    assert "tau is state.tau_J" in ran.out


def test_options_reach_the_reader(cli, two, values, inputs):
    names = ("shoulder", "elbow")
    states = joint_states(values, names, topic="/a")
    path = write_bag(
        inputs / "log", "mcap", merged(states, joint_states(values, names, topic="/b"))
    )
    ran = cli("check", path, "--robot", two)
    assert ran.code == 1
    assert "several topics with states of joints: /a, /b: expected one; name the topic" in ran.out
    ran = cli("check", path, "--robot", two, "--topic", "/a")
    assert "its joints are elbow, shoulder: expected names" in ran.out
    ran = cli("check", path, "--robot", two, "--topic", "/a", "--joints", *names)
    assert ran.code == 0, ran.out + ran.err


@pytest.mark.parametrize("command", ["diagnose", "identify"])
def test_a_bag_without_the_extra_writes_nothing(cli, two, bag, work, command, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    ran = cli(command, bag, "--robot", two)
    assert ran.code == 2
    (line,) = [x for x in ran.lines if x.startswith("error")]
    assert "reading a ROS bag needs rosbags: pip install 'stiction-envs[ros]'" in line
    assert list(work.iterdir()) == []
