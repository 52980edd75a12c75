"""A full disk, or a read-only folder, in the middle of every command that writes.

One line says which file and why, what was written before is whole, nothing half-written is left,
and the same command again ends with the bytes of a run that was never disturbed.
"""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.identification import settings as identification_settings
from stiction_envs.method_settings import override
from stiction_envs.robots import load_arm
from tests.cli.bad_disk import REASONS, BadDisk, Kind
from tests.cli.test_bad_input import BASE_TWO
from tests.cli.test_train import QUICK as PANDA
from tests.cli.test_train import SETTINGS
from tests.experiments.test_conformance import lugre
from tests.gap.small_logs import hidden, sliding, write_csv
from tuning.robot import session
from tuning.settings import tuning_settings

KINDS: tuple[Kind, ...] = ("full", "read-only")
ONCE = ["--iterations", 1]
SEARCH = ["--protocol", "search", "--sampler", "random", "--evaluations", 2]
GROWING = ("trials.csv", "curve.csv", "policy.zip", "provenance.json")
FEW = {"robot.frequencies": 2, "robot.amplitudes": 2, "robot.iterations": 1}


@dataclass(frozen=True)
class Command:
    """A command line, what it is again after a failure, and at how many writes it is tried."""

    argv: tuple[object, ...]
    resumes: bool = False
    points: int = 1
    out: str = "out"


QUICK = {
    "excite": Command(("excite", "TWO", "--rate", 50, "--harmonics", 3, "--base-frequency", 0.2)),
    "export": Command(("export", "TWO"), points=5),
    "conformance": Command(("conformance", "SLIDER"), points=5),
    "identify": Command(("identify", "LOG", "--robot", "TWO")),
}
SLOW = {
    "sje": Command(("sje", "TWO", *ONCE, "--no-scatter")),
    "gte": Command(("gte", "panda", "--trajectory", "PATH", "--stiffness", 500, 30, 0, *ONCE)),
    "calibrate": Command(("calibrate", "TWO", "BASE"), out="out/friction.toml"),
    "diagnose": Command(("diagnose", "LOG", "--robot", "TWO", "--method", "lsm")),
    "evaluate": Command(("evaluate", "panda", "sje", "--policy", "none", "--episodes", 2, *PANDA)),
    "tune": Command(
        ("tune", "TWO", *ONCE, "--no-scatter", "--frequencies", 15, "--scales", 1.0), True
    ),
    "tune journal": Command(
        (
            *("tune", "TWO", *ONCE, "--no-scatter", "--frequencies", 15, "--scales", 1.0),
            *("--storage", "study.journal"),
        ),
        True,
    ),
    "search": Command(("tune", "TWO", *SEARCH), True),
    "ask": Command(("tune", "TWO", "--protocol", "search", "--ask"), True),
    "tell": Command(("tune", "TWO", "--protocol", "search", "--tell", "TOLD", "--ask"), True),
    "train": Command(
        ("train", "panda", "sje", "--algo", "ppo", "--steps", 64, "--settings", "SMALL", *PANDA),
        True,
        points=2,
    ),
    "reproduce": Command(("reproduce", "--only", "2.3"), True),
}


@pytest.fixture
def files(inputs, two) -> dict[str, Path]:
    """Input files, by the words that stand for them in a command line."""
    write_csv(inputs / "log.csv", hidden(load_arm(two), lambda q, dq, ddq: 0.5 * sliding(q)))
    (inputs / "slider.xml").write_text(lugre("2000 12 0.5 0.6 0.003"))
    (inputs / "base.csv").write_text(BASE_TWO)
    (inputs / "small.toml").write_text(SETTINGS)
    head = "robot,joint,frequency_hz,amplitude_nm,load,direction,tau_nm\n"
    rows = [
        f"two,{j},{f},{a},{load},{d},{d}{tau}\n"
        for j in (1, 2)
        for f, a, tau in ((0, 0, 0.8), (15, 0.3, 0.7))
        for load in ("load", "no_load")
        for d in "+-"
    ]
    (inputs / "told.csv").write_text(head + "".join(rows))
    (inputs / "path.csv").write_text("x,y,z\n0.03,0,0\n0,0.03,0\n")
    names = {
        "PATH": "path.csv",
        "LOG": "log.csv",
        "SLIDER": "slider.xml",
        "BASE": "base.csv",
        "SMALL": "small.toml",
    }
    return {"TWO": two, "TOLD": inputs / "told.csv"} | {k: inputs / v for k, v in names.items()}


@pytest.fixture
def run(cli, work, files, monkeypatch):
    """Run a command in a folder of its own, on a disk that may be bad."""
    few = {"excitation": {"iterations": 6, "randoms": 3, "starts": 1}}
    motion = override(identification_settings.identification_settings(), few)
    monkeypatch.setattr(identification_settings, "identification_settings", lambda: motion)
    asked = override(tuning_settings(), FEW)
    monkeypatch.setattr(session, "tuning_settings", lambda: asked)

    def run(command: Command, name: str, disk: BadDisk | None = None, *more: str):
        (work / name).mkdir(exist_ok=True)
        monkeypatch.chdir(work / name)
        argv = [files.get(a, a) if isinstance(a, str) else a for a in command.argv]
        argv += ["--out", command.out, "--threads", 1]
        with disk or nullcontext():
            return cli(*argv, *more)

    return run


def below(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder but those that hold times or are there to go on alone."""
    found = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file()}
    timed = (".db", ".journal", ".pt", ".npz", "state.json")
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
    assert any(x in errors[0] for x in ("/out", " out", "study.journal", "arm.xml")), errors


@pytest.mark.parametrize("name", QUICK)
def test_quick_commands(run, work, name):
    check_disk(run, work, name, QUICK[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_slow_commands(run, work, name):
    check_disk(run, work, name, SLOW[name])
