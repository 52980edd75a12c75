"""``stiction diagnose --rrd``: written with the rest, or refused before any work."""

from __future__ import annotations

import json
import sys

import pytest

from tests.cli.short_commands import BASE_TWO


@pytest.mark.slow
def test_a_recording_is_written_with_the_report(cli, two, log, work):
    """In the output folder, which lists it."""
    ran = cli("diagnose", log, "--robot", two, "--out", "a", "--rrd", "a/x.rrd")
    assert ran.code == 0, ran.err
    assert ran.out.endswith("written to a: report.html\nwritten: a/x.rrd\n")
    made = json.loads((work / "a/provenance.json").read_text())
    assert {"x.rrd", "series.csv"} <= set(made["files"])
    assert "rrd" not in made["arguments"]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--rrd", "x"), "output x: ends in 'nothing': expected a path to a .rrd"),
        (("--rrd", "none/x.rrd"), "output none/x.rrd: none: expected a folder that is there"),
        (("--rrd", "x.rrd", "--rehearse"), "--rrd: cannot be used with --rehearse"),
    ],
)
def test_what_cannot_be_written_is_one_line_and_nothing_is_done(cli, two, log, work, options, says):
    ran = cli("diagnose", log, "--robot", two, *options)
    assert ran.code == 2
    assert ran.lines == [f"error: {says}"]
    assert list(work.iterdir()) == []


def test_a_torque_table_has_no_series(cli, two, inputs, work):
    table = inputs / "base.csv"
    table.write_text(BASE_TWO)
    ran = cli("diagnose", table, "--robot", two, "--rrd", "x.rrd")
    assert ran.code == 2
    assert ran.lines == [f"error: --rrd: {table} is a torque table: expected logs"]


def test_a_missing_package_is_named_before_any_work(cli, two, log, work, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    ran = cli("diagnose", log, "--robot", two, "--rrd", "x.rrd")
    assert ran.code == 2
    assert ran.lines[0].endswith("needs rerun-sdk: pip install 'stiction-envs[rerun]'")
    assert list(work.iterdir()) == []
