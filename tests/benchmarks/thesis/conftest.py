from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.thesis import command
from stiction_envs.cli import main
from tests.cli.conftest import Ran


@pytest.fixture
def work(tmp_path, monkeypatch) -> Path:
    """Empty working folder, entered."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def thesis(work, capsys) -> Callable[..., Ran]:
    """Run `python -m benchmarks.thesis` in the working folder."""

    def run(*argv: object) -> Ran:
        capsys.readouterr()
        code = main(["reproduce", *map(str, argv)], [command])
        out, err = capsys.readouterr()
        return Ran(code, out, err)

    return run
