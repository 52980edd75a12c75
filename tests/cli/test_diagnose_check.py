"""``stiction diagnose --check``: logs that took no part, in every file and on the terminal."""

from __future__ import annotations

import json

import numpy as np
import pytest

from stiction_envs.robots import load_arm
from tests.gap.small_logs import hidden, sliding, write_csv
from tests.robots.arms import chain

KEYS = {"nominal_rms_nm", "extended_rms_nm", "verdict", "worse_joints", "not_transferring"}


def sprung(q, dq, ddq):
    """Friction, and a cable on joint 1 that another day is not there."""
    return 0.5 * sliding(q) + np.array([3.0, 0.0]) * q


@pytest.fixture
def arm(two):
    return load_arm(two)


@pytest.fixture
def log(arm, inputs):
    write_csv(inputs / "log.csv", hidden(arm, sprung))
    return inputs / "log.csv"


@pytest.fixture
def other(arm, inputs):
    write_csv(inputs / "other.csv", hidden(arm, lambda q, dq, ddq: 0.5 * sliding(q), seed=7))
    return inputs / "other.csv"


@pytest.mark.slow
def test_a_log_that_took_no_part_is_in_every_file(cli, work, two, log, other):
    done = cli("diagnose", log, "--robot", two, "--check", other, "--out", "a", "--json")
    assert done.code == 0, done.err
    found = json.loads((work / "a/diagnosis.json").read_text("utf-8"))
    assert {x for x in found if x == "left_out_motion"} == set()
    check = found["check"]
    assert set(check) == KEYS
    assert check["verdict"] == "does not hold"
    assert check["worse_joints"] == [1]
    assert check["not_transferring"] == ["external_spring"]
    assert len(check["nominal_rms_nm"]) == len(check["extended_rms_nm"]) == 2
    assert check["extended_rms_nm"][0] > check["nominal_rms_nm"][0]
    answer = json.loads(done.out)
    assert answer["check"] == check
    assert "does not hold on joint 1" in answer["summary"]
    text = (work / "a/report.md").read_text("utf-8")
    for words in ("## Check on logs that took no part", "**worse**", "**does not transfer**"):
        assert words in text
    assert "`other.csv` (check): 3000 rows" in text
    assert (work / "a/plots/check.png").is_file()
    assert "Check on logs" in (work / "a/report.html").read_text("utf-8")
    told = json.loads((work / "a/provenance.json").read_text("utf-8"))
    assert set(told["inputs"]) >= {"log1", "check1"}
    assert "check 1 | `other.csv`" in text
    # the diagnosis is that without it
    done = cli("diagnose", log, "--robot", two, "--out", "b")
    assert done.code == 0
    alone = json.loads((work / "b/diagnosis.json").read_text("utf-8"))
    assert "check" not in alone
    assert {**alone, "check": check} == found
    assert (work / "a/model.xml").read_bytes() == (work / "b/model.xml").read_bytes()


@pytest.mark.slow
def test_several_logs_are_left_out_one_by_one(cli, work, two, arm, inputs, other):
    paths = [inputs / f"log{k}.csv" for k in (1, 2)]
    for k, path in enumerate(paths, 1):
        write_csv(path, hidden(arm, lambda q, dq, ddq: 0.5 * sliding(q), seed=k))
    done = cli("diagnose", *paths, "--robot", two, "--check", other, "--out", "a")
    assert done.code == 0, done.err
    assert "the model holds" in done.out
    found = json.loads((work / "a/diagnosis.json").read_text("utf-8"))
    assert found["check"]["verdict"] == "holds"
    left = found["left_out_motion"]
    assert left["motions"] == ["log1.csv", "log2.csv"]
    assert {(c["name"], c["verdict"]) for c in left["causes"]} == {
        ("coulomb_friction", "transfers")
    }
    assert "### One motion left out" in (work / "a/report.md").read_text("utf-8")


@pytest.mark.parametrize(
    ("case", "says"),
    [
        ("gone", "gone.csv: no such file"),
        ("text", "other.csv"),
        ("empty", "other.csv"),
        ("short", "expected 1 s or more"),
        ("three joints", "columns for 3 joints, but the robot has 2"),
        ("diagnosed", "it is diagnosed too"),
        ("still", "expected one or more that move in both"),
        ("table", "table.csv is a torque table: expected joint logs"),
        ("of a table", "is a torque table: expected joint logs"),
    ],
)
def test_bad_check_logs_are_one_line_and_nothing_is_written(
    cli, work, two, arm, inputs, log, case, says
):
    path = inputs / (
        "gone.csv" if case == "gone" else "table.csv" if "table" in case else "other.csv"
    )
    given = log
    if case == "text":
        path.write_text("nothing of the kind\n")
    elif case == "empty":
        path.write_text("")
    elif case == "short":
        write_csv(path, hidden(arm, seconds=0.6))
    elif case == "three joints":
        (inputs / "three.xml").write_text(chain(3))
        write_csv(path, hidden(load_arm(inputs / "three.xml"), seconds=3.0))
    elif case == "diagnosed":
        path = log
    elif case == "still":
        made = hidden(arm, seconds=3.0)
        still = type(made)(source="x", t=made.t, q=0.01 * made.q, dq=None, tau=made.tau)
        write_csv(path, still)
    elif "table" in case:
        path.write_text(
            "robot,joint,load,direction,frequency_hz,amplitude_nm,tau_nm,std_nm,iterations,reduction\n"
            "two,1,load,+,0,0,0.5,0.01,4,0\n"
        )
        if case == "of a table":
            given, path = path, log
    done = cli("diagnose", given, "--robot", two, "--check", path)
    assert done.code == 2, done.err
    assert len(done.lines) == 1
    assert says in done.lines[0]
    assert list(work.iterdir()) == []
