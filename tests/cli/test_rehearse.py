"""``stiction diagnose --rehearse``: its file, its words, going on, and what it refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest

from stiction_envs.hidden.examples import log_csv
from stiction_envs.hidden.servo_logs import hide
from stiction_envs.robots import load_arm
from tests.cli.short_commands import BASE_TWO
from tests.command_line import csv_rows

FILES = {"rehearsal.csv", "rehearsal_runs.jsonl", "provenance.json"}
COLUMNS = ["cause", "joint", "parameter", "unit", "smallest_found"]


@pytest.fixture
def call(log, two):
    """A command line of a rehearsal with few causes."""
    causes = ("--rehearse-causes", "coulomb_friction", "viscous_friction", "--threads", 1)
    return ("diagnose", "--rehearse", log, "--robot", two, *causes)


@pytest.mark.slow
def test_writes_and_prints_the_smallest_sizes(cli, work, call):
    ran = cli(*call, "--out", "a")
    assert ran.code == 0, ran.err
    assert {p.name for p in (work / "a").iterdir()} == FILES
    rows = csv_rows(work / "a/rehearsal.csv")
    assert list(rows[0])[: len(COLUMNS)] == COLUMNS
    assert [(r["cause"], r["joint"]) for r in rows] == [
        (name, joint) for name in ("coulomb_friction", "viscous_friction") for joint in "12"
    ]
    assert all(float(r["smallest_found"]) > 0 for r in rows)
    assert "Of 4 causes, counted on each joint, this recording shows 4 at one of" in ran.out
    assert "coulomb_friction, coulomb_nm [N·m]" in ran.out
    assert ran.out.endswith("written to a: rehearsal.csv\n")
    assert "hid viscous_friction in the log" in ran.err

    # as JSON, and finished runs are not done again
    again = cli(*call, "--out", "a", "--json")
    assert again.code == 0, again.err
    found = json.loads(again.out)
    assert [r["smallest_found"] for r in found["rehearsal"]] == pytest.approx(
        [float(r["smallest_found"]) for r in rows], rel=1e-3
    )
    assert found["named_without"] == []
    assert "hid" not in again.err


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (("--check", "{log.csv}"), "--check: cannot be used with --rehearse"),
        (("--poses", "{log.csv}"), "--poses: cannot be used with --rehearse"),
        (("--rehearse-causes", "rust"), "unknown cause 'rust': expected one of coulomb_friction"),
        (("--cutoff", "nan"), "expected"),
    ],
)
def test_bad_input(refused, call, more, says):
    assert says in refused(*call, "--out", "a", *more)


def test_a_rehearsal_needs_a_log(refused, inputs, two, log):
    (inputs / "base.csv").write_text(BASE_TWO)
    asked = ("diagnose", "--robot", two, "--out", "a")
    assert "no log given" in refused(*asked, "--rehearse")
    assert "is a torque table: expected joint logs" in refused(*asked, "--rehearse", "{base.csv}")
    line = refused(*asked, log, "--rehearse-causes", "payload")
    assert line == "error: --rehearse-causes: expected --rehearse too"


# ---- servo logs ----------------------------------------------------------------------------------


@pytest.fixture
def servo_call(two, inputs):
    """A log of positions of the small arm, whose servos are known; one cause is hidden in it."""
    h = hide(load_arm(two), (), seed=3, seconds=20.0, start=np.array([-0.6, 0.8]))
    path = inputs / "servo.csv"
    path.write_text(log_csv(h.log.t, digits=9, q_cmd=h.log.q_cmd, q=h.log.q))
    known = ("--servo-stiffness", *h.stiffness, "--servo-damping", *h.damping)
    return ("diagnose", "--rehearse", path, "--robot", two, *known, "--threads", 1, "--out", "a")


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (("--rehearse-causes", "viscous_friction"), "expected one of servo_stiffness, damping"),
        (("--cutoff", 5), "cutoff: expected joint logs"),
        (("--torque", "link"), "torque: expected joint logs"),
        (("--nominal", "shipped"), "servo logs expect rigid"),
    ],
)
def test_bad_input_of_a_servo_log(refused, servo_call, more, says):
    assert says in refused(*servo_call, *more)
