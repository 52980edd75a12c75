"""Command lines run in an empty folder: fixtures of all tests that need one."""

import csv
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest

from stiction_envs.cli import main
from tests.robots.arms import TWO

ROOT = Path(__file__).parents[1]


def python(
    code: str, *, cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run code in a process of its own, which finds this checkout from everywhere."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    words = [sys.executable, "-c", code]
    return subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False)


@dataclass
class Ran:
    """Result of a command line."""

    code: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        """Lines on standard error."""
        return self.err.splitlines()


def contents(*folders: Path) -> dict[Path, bytes | None]:
    """Return the files below folders with their bytes, and the folders in them."""
    found = [p for folder in folders for p in folder.rglob("*")]
    return {p: p.read_bytes() if p.is_file() else None for p in found}


def csv_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table by its columns."""
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def inputs(tmp_path) -> Path:
    """Folder of input files, apart from the working folder."""
    folder = tmp_path / "inputs"
    folder.mkdir()
    return folder


@pytest.fixture
def work(tmp_path, monkeypatch) -> Path:
    """Empty working folder, entered."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def cli(work, inputs, capsys) -> Callable[..., Ran]:
    """Run a command line in the working folder; names in braces are those of files of ``inputs``.

    ``commands`` are those of `main`.
    """

    def run(*argv: object, commands: Iterable[object] | None = None) -> Ran:
        words = [str(a) for a in argv]
        for path in inputs.iterdir():
            words = [w.replace(f"{{{path.name}}}", str(path)) for w in words]
        capsys.readouterr()
        code = main(words, commands)
        return Ran(code, *capsys.readouterr())

    return run


@pytest.fixture
def refused(cli, work, inputs) -> Callable[..., str]:
    """Run a command line that is bad input: nothing is written; returns the one line of error."""

    def run(*argv: object) -> str:
        before = contents(work, inputs)
        ran = cli(*argv)
        assert (ran.code, ran.out) == (2, ""), ran
        (line,) = ran.lines
        assert line.startswith("error: ")
        assert contents(work, inputs) == before
        return line

    return run


@pytest.fixture
def two(inputs) -> Path:
    """MJCF of an arm of two joints that feel gravity: quick to simulate."""
    path = inputs / "two.xml"
    path.write_text(TWO)
    return path


@pytest.fixture
def dither(inputs) -> Path:
    """Amplitude table for joint 7."""
    path = inputs / "dither.csv"
    path.write_text("joint,frequency_hz,amplitude_nm\n7,15,0.6\n")
    return path
