"""``stiction check``: a finding in a line, and an exit code that says whether one is a defect."""

import csv
import json

import numpy as np
import pytest

from stiction_envs.robots import load_arm
from tests.gap.small_logs import hidden, write_csv
from tests.measured.checks.test_checks import THESIS, sje, write_sje
from tests.measured.checks.test_thesis_forms import IN_PRINT


@pytest.fixture
def clean(inputs):
    path = inputs / "sje.csv"
    write_sje(path, sje(np.random.default_rng(0)))
    return path


@pytest.fixture
def log(inputs, two):
    path = inputs / "log.csv"
    write_csv(path, hidden(load_arm(two), seconds=4.0))
    return path


def test_nothing_wrong(cli, work, clean, log, two):
    ran = cli("check", clean, log, "--robot", two)
    assert ran.code == 0, ran.out
    assert ran.out == "nothing wrong\n"
    assert ran.err == ""
    assert list(work.iterdir()) == []
    # the number of joints is told from the columns
    assert cli("check", log).code == 0


def test_the_thesis_in_print(cli, work):
    """All twelve tables at once: their misprints, and what contradicts between them."""
    tables = sorted(THESIS.glob("table_*.csv"))
    assert len(tables) == 12
    ran = cli("check", *tables, "--json", "--out", "found")
    assert ran.code == 1
    found = json.loads(ran.out)["findings"]
    misprints = [x for x in found if x["kind"] != "remark"]
    assert ran.lines == [f"error: {len(misprints)} defects found"]
    assert "panda joint 5, no_load +, intermediate" in {x["where"] for x in misprints}
    # weights that are not in the tables are not known here
    assert len(found) >= sum(map(len, IN_PRINT.values())) - 3
    with open(work / "found" / "findings.csv", encoding="utf-8") as file:
        assert list(csv.DictReader(file)) == found
    assert json.loads((work / "found" / "provenance.json").read_text())["finished"]


def test_remarks_are_no_defects(cli, work):
    ran = cli("check", *(THESIS / f"table_4_{i}.csv" for i in (3, 5, 6)))
    assert ran.code == 0
    assert ran.out.count(": remark: ") == len(ran.out.splitlines()) == 5


def test_a_log_says_what_was_corrected_and_what_was_not(cli, inputs, log, two):
    """A repeated row, a column nobody knows, a torque that stands at its limit."""
    header, *rows = log.read_text().splitlines()
    rows[100:100] = rows[99:100]
    cells = [row.split(",") for row in rows]
    for k in range(300, 330):
        cells[k][4] = "9.0"
    text = "\n".join([header + ",mood", *(",".join([*c, "1"]) for c in cells)])
    log.write_text(text + "\n")
    ran = cli("check", log, "--robot", two)
    assert ran.code == 1
    kinds = [line.split(": ")[1] for line in ran.out.splitlines()]
    assert sorted(kinds) == ["corrected", "remark", "warning"]
    assert "'mood'" in ran.out
    assert "tau2 stays at its largest value" in ran.out


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,q1,q2,tau1,tau2\n0,0,0,0,0\n1,9,9,9,9\n0.5,0,0,0,0\n", "unreadable: line 4: t falls"),
        ("t,q1,tau1\n0,0,up\n", "unreadable: line 2: tau1 is 'up'"),
        ("t,x\n0,0\n", "unreadable: no column q1"),
        ("", "unreadable: empty file"),
        ("robot,joint,load,direction,tau_base_Nm\narm,1,load,+,0,4\n", "unreadable: line 2: 6 val"),
        ("robot,joint,load,direction,tau_base_Nm\narm,1,load,+,x\n", "unreadable: line 2: tau_bas"),
        (
            "robot,joint,load,direction,tau_base_Nm\narm,1,load,up,0.4\n",
            "unreadable: line 2: unknown direction",
        ),
    ],
)
def test_a_file_that_nothing_can_be_done_with_is_a_defect(cli, inputs, clean, text, says):
    """It is what was asked for; the other files are checked all the same."""
    path = inputs / "bad.csv"
    path.write_text(text)
    ran = cli("check", path, clean)
    assert ran.code == 1
    (line,) = ran.out.splitlines()
    assert line.startswith(f"{path}: {says}"), line
    assert ran.lines == ["error: 1 defect found"]


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        ([], "FILE"),
        (["nowhere.csv"], "nowhere.csv: no such file"),
        (["{notes}"], "neither a torque table nor a joint log"),
        (["{clean}", "--robot", "robbie"], "unknown robot 'robbie'"),
        (["{clean}", "--out", "{clean}"], "is a file"),
    ],
)
def test_bad_input(cli, work, inputs, clean, argv, says):
    (inputs / "notes.csv").write_text("a,b\n1,2\n")
    names = {"notes": inputs / "notes.csv", "clean": clean}
    ran = cli("check", *(a.format(**names) for a in argv))
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert says in ran.lines[0]
    assert ran.out == ""
    assert list(work.iterdir()) == []


def test_help_says_what_the_exit_codes_are(cli, work):
    assert "1 defects found" in cli("check", "--help").out
