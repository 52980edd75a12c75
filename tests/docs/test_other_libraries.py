"""The arm and its environments in other people's libraries, as the pages show them."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.command_line import ROOT
from tests.docs.test_pages import DOCS, run, run_page

GPU, STACK = DOCS / "gpu.md", DOCS / "stack.md"


def shown(page: Path) -> list[str]:
    """Return the blocks of Python that a page shows and does not run."""
    text = page.read_text(encoding="utf-8")
    return re.findall(r"^```{code-block} python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


OTHERS = dict(zip(("torchrl", "skrl"), shown(STACK), strict=True))


def printed(python: str, code: str, folder: Path = ROOT) -> str:
    """Return the last line that a block prints."""
    command = [python, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    ("page", "needs"),
    [
        (GPU, "mujoco_warp"),
        pytest.param(STACK, "stable_baselines3", marks=pytest.mark.slow),
    ],
)
def test_the_page_runs_and_prints_what_it_shows(page, needs, tmp_path):
    pytest.importorskip(needs)
    run(page, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("package", OTHERS)
def test_a_library_that_is_not_installed_here_prints_what_the_page_shows(package):
    pytest.importorskip(package)
    line = printed(sys.executable, OTHERS[package])
    assert f"It printed `{line}`" in STACK.read_text(encoding="utf-8")


def test_the_arm_sticks_in_mjlab(tmp_path, monkeypatch):
    """In an environment of its own, whose Python the variable MJLAB_PYTHON names."""
    if not (python := os.environ.get("MJLAB_PYTHON")):
        pytest.skip("MJLAB_PYTHON names no environment with mjlab")
    monkeypatch.chdir(tmp_path)
    run_page.run_command(run_page.commands(GPU)[-1])
    monkeypatch.delenv("PYTHONPATH", raising=False)
    (block,) = shown(GPU)
    held, went = map(float, re.findall(r"[\d.e-]+", printed(python, block, tmp_path)))
    assert held < 0.001
    assert went > 0.1
