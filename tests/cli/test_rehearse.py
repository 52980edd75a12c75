"""``stiction diagnose --rehearse``: its file, its words, and going on."""

import json

import pytest

from tests.command_line import csv_rows

FILES = {"rehearsal.csv", "rehearsal_runs.jsonl", "provenance.json"}
COLUMNS = ["cause", "joint", "parameter", "unit", "smallest_found"]


@pytest.mark.slow
def test_writes_and_prints_the_smallest_sizes(cli, work, log, two):
    causes = ("--rehearse-causes", "coulomb_friction", "viscous_friction", "--threads", 1)
    call = ("diagnose", "--rehearse", log, "--robot", two, *causes)
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
