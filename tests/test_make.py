"""The Makefile builds the environment of the Python that it is given, and of no other."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def make_env(folder: Path) -> None:
    """Build the environment without its packages."""
    command = ["make", "env", "PIP=true", f"PYTHON={sys.executable}"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)


@pytest.mark.slow
def test_an_environment_of_another_python_is_rebuilt(tmp_path: Path):
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    left = tmp_path / ".venv" / "lib" / "python3.10" / "left"
    left.parent.mkdir(parents=True)
    left.touch()
    for kind in ("run", "dev"):
        (tmp_path / ".venv" / f".stamp-{kind}-3.10.1").touch()
    make_env(tmp_path)
    assert not left.exists()
    stamp = tmp_path / ".venv" / f".stamp-dev-{platform.python_version()}"
    made = stamp.stat().st_mtime_ns
    make_env(tmp_path)
    assert stamp.stat().st_mtime_ns == made  # nothing to do
