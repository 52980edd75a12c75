"""What every command promises: its help, its report, its folder, and what a bad disk leaves.

A full disk, or a read-only folder, in the middle of a command: one line says which file and why,
what was written before is whole, nothing half-written is left, and the same command again ends with
the bytes of a run that was never disturbed.
"""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.cli.dispatch import all_commands
from tests.browser import WIDTHS, wrong
from tests.cli.bad_disk import REASONS, BadDisk, Kind
from tests.cli.short_commands import COMMANDS, QUICK, SLOW, Command
from tests.command_line import contents

KINDS: tuple[Kind, ...] = ("full", "read-only")
GROWING = ("trials.csv", "runs.jsonl", "curve.csv", "policy.zip", "provenance.json")
REPORTING = ("identify", "sje", "gte", "diagnose", "tune", "search", "train", "reproduce")
SIMULATING = ("sje", "gte", "tune", "calibrate", "export", "excite", "view")
NAMES = [module.__name__.rpartition(".")[2] for module in all_commands()]


@pytest.mark.parametrize("name", ["", *NAMES])
def test_help(cli, work, name):
    ran = cli(*name.split(), "--help")
    assert (ran.code, ran.err) == (0, "")
    assert list(work.iterdir()) == []
    if not name:
        assert "0 done" in ran.out
        return
    assert f"example:\n  stiction {name} " in ran.out
    options = {"--json", "--seed"} | (set() if name == "view" else {"--out", "--force"})
    assert ("1 defects found" in ran.out) == (name == "check"), "its exit codes differ"
    if name in SIMULATING:
        options |= {"--payload", "--tilt"}
    assert {o for o in options if o not in ran.out} == set()


@pytest.mark.parametrize("name", QUICK)
def test_another_runs_files_are_replaced_only_by_force(run_short, work, name):
    assert run_short(QUICK[name], "here").code == 0
    before = contents(work)
    ran = run_short(QUICK[name], "here", None, "--seed", 3)
    assert (ran.code, len(ran.lines)) == (2, 1)
    assert f"a run of stiction {name}" in ran.err
    assert contents(work) == before
    assert run_short(QUICK[name], "here", None, "--seed", 3, "--force").code == 0
    if name == "excite":
        motion = work / "here" / "out" / "trajectory.csv"
        assert motion.read_bytes() != before[motion]


@pytest.mark.slow
@pytest.mark.parametrize("name", REPORTING)
def test_a_report_can_be_read_on_a_desk_and_on_a_phone(run_short, work, chromium, name):
    assert run_short(COMMANDS[name], "here").code == 0
    pages = list((work / "here").rglob("*.html"))
    assert pages
    for page in pages:
        for width in WIDTHS:
            assert not wrong(chromium, page, width), (page.name, width)


# ---- a bad disk ----------------------------------------------------------------------------------


def below(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder but those that hold times or are there to go on alone."""
    found = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file()}
    timed = (".db", ".pt", ".npz", "state.json")
    return {k: p.read_bytes() for k, p in found.items() if not k.endswith(timed)}


def check_whole(folder: Path, kind: Kind) -> None:
    """No file is half-written, none is a leftover; but nothing can be removed while read-only."""
    for path in folder.rglob("*"):
        if kind == "read-only" and (".part" in path.name or "next" in path.parts):
            continue
        assert ".part" not in path.name, path
        assert path.name != "next", path
        assert not path.name.endswith("-wal"), path
        if path.suffix == ".json":
            json.loads(path.read_text("utf-8"))
        if path.suffix == ".db":
            with closing(sqlite3.connect(path)) as base:
                assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)


def drawn(name: str, count: int, points: int, kind: Kind) -> list[int]:
    """Return the writes that fail: some of all, others for every command, the same every time."""
    rng = np.random.default_rng([*name.encode(), *kind.encode()])
    return sorted(int(k) for k in rng.choice(np.arange(1, count + 1), min(points, count), False))


def check_disk(run, work: Path, name: str, command: Command) -> None:
    watched = BadDisk(work / "clean")
    assert run(command, "clean", watched).code == 0
    clean = below(work / "clean")
    for kind in KINDS:
        for at in drawn(name, watched.counts[kind], command.points, kind):
            where = f"{kind} from write {at} of {watched.counts[kind]} on"
            folder = work / where
            ran = run(command, where, disk := BadDisk(folder, at, kind))
            assert disk.broken, where
            check_one_line(ran, where)
            check_whole(folder, kind)
            left = {k: v for k, v in below(folder).items() if ".part" not in k}
            growing = {k for k in left if k.endswith(GROWING)}
            assert {k: v for k, v in left.items() if clean.get(k) != v}.keys() <= growing, where
            begun = any(folder.iterdir())
            assert ran.code == 1 or (ran.code == 2 and not (folder / "out").exists()), where
            more = ["--force"] if begun and not command.resumes else []
            again = run(command, where, None, *more)
            assert again.code == 0, (where, again.err)
            assert below(folder) == clean, where


def check_one_line(ran, where: str) -> None:
    """The last line is the one error: what could not be written, and why; no traceback."""
    errors = [line for line in ran.lines if line.startswith("error: ")]
    assert ran.lines[-1:] == errors, (where, ran.lines)
    assert "Traceback" not in ran.err, (where, ran.err)
    assert "STICTION_DEBUG" not in errors[0], where
    assert any(reason in errors[0].lower() for reason in REASONS), (where, errors)
    assert any(x in errors[0] for x in ("/out", " out", "arm.xml")), errors


@pytest.mark.parametrize("name", QUICK)
def test_quick_commands(run_short, work, name):
    check_disk(run_short, work, name, QUICK[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_slow_commands(run_short, work, name):
    check_disk(run_short, work, name, SLOW[name])
