"""``stiction diagnose --rrd --mcap``: written with the rest, or refused before any work."""

from __future__ import annotations

import json
import sys

import pytest

from stiction_envs.robots import load_arm
from tests.cli.short_commands import BASE_TWO
from tests.gap.small_logs import dry, hidden, write_csv


@pytest.fixture
def log(two, inputs):
    """A log of the small arm with dry friction."""
    path = inputs / "log.csv"
    write_csv(path, hidden(load_arm(two), dry, seconds=8.0))
    return path


def test_both_are_written_with_the_report(cli, two, log, work):
    """One in the output folder, which lists it, one elsewhere."""
    call = ("diagnose", log, "--robot", two, "--out", "a", "--rrd", "a/x.rrd", "--mcap", "x.mcap")
    ran = cli(*call)
    assert ran.code == 0, ran.err
    assert ran.out.endswith("written to a: report.html\nwritten: a/x.rrd\nwritten: x.mcap\n")
    made = json.loads((work / "a/provenance.json").read_text())
    assert "x.rrd" in made["files"]
    assert not {"rrd", "mcap"} & set(made["arguments"])
    read = cli("check", "x.mcap", "--robot", two, "--topic", "/measured")
    assert read.code == 0, read.out + read.err

    again = cli(*call)
    assert again.code == 2
    (line,) = again.lines
    assert "output a: holds a run" in line
    ran = cli(*call, "--force", "--json")
    assert ran.code == 0, ran.err
    found = json.loads(ran.out)
    assert (found["rrd"], found["mcap"]) == ("a/x.rrd", "x.mcap")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--rrd", "x.mcap"), "output x.mcap: ends in '.mcap': expected a path to a .rrd"),
        (("--mcap", "x"), "output x: ends in 'nothing': expected a path to a .mcap"),
        (("--rrd", "none/x.rrd"), "output none/x.rrd: none: expected a folder that is there"),
        (("--mcap", "x.mcap", "--rehearse"), "--mcap: cannot be used with --rehearse"),
    ],
)
def test_what_cannot_be_written_is_one_line_and_nothing_is_done(cli, two, log, work, options, says):
    ran = cli("diagnose", log, "--robot", two, *options)
    assert ran.code == 2
    assert ran.lines == [f"error: {says}"]
    assert list(work.iterdir()) == []


def test_a_file_that_is_there_stays(cli, two, log, work):
    (work / "x.rrd").write_text("mine")
    ran = cli("diagnose", log, "--robot", two, "--rrd", "x.rrd")
    assert ran.code == 2
    assert ran.lines == ["error: output x.rrd: exists: choose another name, or force"]
    assert (work / "x.rrd").read_text() == "mine"
    assert len(list(work.iterdir())) == 1


def test_a_torque_table_has_no_series(cli, two, inputs, work):
    table = inputs / "base.csv"
    table.write_text(BASE_TWO)
    ran = cli("diagnose", table, "--robot", two, "--rrd", "x.rrd")
    assert ran.code == 2
    assert ran.lines == [f"error: --rrd: {table} is a torque table: expected logs"]
    assert list(work.iterdir()) == []


@pytest.mark.parametrize(
    ("option", "package", "says"),
    [
        ("rrd", "rerun", "needs rerun-sdk: pip install 'stiction-envs[rerun]'"),
        ("mcap", "rosbags.rosbag2", "needs rosbags: pip install 'stiction-envs[ros]'"),
    ],
)
def test_a_missing_package_is_named_before_any_work(
    cli, two, log, work, monkeypatch, option, package, says
):
    monkeypatch.setitem(sys.modules, package, None)
    ran = cli("diagnose", log, "--robot", two, f"--{option}", f"x.{option}")
    assert ran.code == 2
    (line,) = ran.lines
    assert line.endswith(says)
    assert list(work.iterdir()) == []
