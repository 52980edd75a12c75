from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from stiction_envs.cli import main
from tests.cli.short_commands import run_short, short_inputs  # noqa: F401
from tests.robots.arms import chain


@dataclass
class Ran:
    code: int
    out: str
    err: str

    @property
    def lines(self) -> list[str]:
        """Lines on standard error."""
        return self.err.splitlines()


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
def cli(work, capsys) -> Callable[..., Ran]:
    """Run a command line in the working folder."""

    def run(*argv: object) -> Ran:
        capsys.readouterr()
        code = main([str(a) for a in argv])
        out, err = capsys.readouterr()
        return Ran(code, out, err)

    return run


@pytest.fixture
def two(inputs) -> Path:
    """MJCF of an arm of two joints that feel gravity: quick to simulate."""
    path = inputs / "two.xml"
    path.write_text(chain(2, extra='<geom pos="0.15 0 0.1" size="0.05" mass="1"/>'))
    return path


@pytest.fixture
def dither(inputs) -> Path:
    """Amplitude table for joint 7."""
    path = inputs / "dither.csv"
    path.write_text("joint,frequency_hz,amplitude_nm\n7,15,0.6\n")
    return path
