"""The exported arm sticks in MuJoCo Warp (extra warp) and in mjlab, as the page says."""

from __future__ import annotations

import os
import re
import subprocess

import pytest

from tests.docs.test_pages import DOCS, run, run_page

PAGE = DOCS / "gpu.md"
MJLAB_BLOCK = re.compile(r"^```{code-block} python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def test_the_arm_sticks_in_mujoco_warp(tmp_path):
    pytest.importorskip("mujoco_warp")
    done = run(PAGE, tmp_path)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr}"


def test_the_arm_sticks_in_mjlab(tmp_path, monkeypatch):
    """In an environment of its own, whose Python the variable MJLAB_PYTHON names."""
    if not (python := os.environ.get("MJLAB_PYTHON")):
        pytest.skip("MJLAB_PYTHON names no environment with mjlab")
    monkeypatch.chdir(tmp_path)
    run_page.run_command(run_page.commands(PAGE)[-1])
    monkeypatch.delenv("PYTHONPATH", raising=False)
    (block,) = MJLAB_BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    done = subprocess.run([python, "-c", block], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    held, went = map(float, re.findall(r"[\d.e-]+", done.stdout.splitlines()[-1]))
    assert held < 0.001
    assert went > 0.1
