"""The three ways in: a picture, three lines to type, and every block prints what is shown."""

import importlib.util
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from stiction_envs.measured.logs.reader import read_logs
from tests.command_line import ROOT

DOCS = ROOT / "docs"
SPEC = importlib.util.spec_from_file_location("run_page", DOCS / "run_page.py")
run_page = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(run_page)
PAGES = sorted(run_page.PICTURES)
EXAMPLES = sorted((DOCS / "examples").glob("*.md"))
SCREEN = 80
"""Most lines of an example; assumed."""


def run(page, folder, code=0):
    """Run a page, which ends with an exit code."""
    done = subprocess.run(
        [sys.executable, DOCS / "run_page.py", page, folder],
        env={"MUJOCO_GL": "egl", **os.environ},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, f"{done.stdout[-3000:]}\n{done.stderr}"
    return done


def test_the_reader_of_logs_writes_a_log_that_is_read(tmp_path):
    seconds = np.arange(2000) / 1000
    angles = np.sin(seconds[:, None] * np.arange(1, 8))
    torques = np.random.default_rng(0).normal(size=angles.shape)
    micro = 1e6 * seconds
    np.savez(tmp_path / "robot.npz", time_us=micro, angles=angles, torques=torques)
    run(DOCS / "extending.md", tmp_path)
    (log,) = read_logs([tmp_path / "log.csv"], 7)
    np.testing.assert_allclose(log.tau, torques)
    np.testing.assert_allclose(log.t, seconds, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_a_page_runs_and_prints_what_it_shows(page, tmp_path):
    run(DOCS / f"{page}.md", tmp_path)
    for name, source in run_page.PICTURES[page].items():
        made, shown = (Image.open(x).size for x in (tmp_path / source, DOCS / name))
        assert made == shown, f"{name} is not what the page makes: python docs/make_pictures.py"


@pytest.mark.parametrize(
    "page",
    [DOCS / "theory.md", *(pytest.param(x, marks=pytest.mark.slow) for x in EXAMPLES)],
    ids=lambda page: page.stem,
)
def test_theory_and_examples_run_and_print_what_they_show(page, tmp_path):
    run(page, tmp_path)


def test_an_example_is_short_answers_first_and_is_linked():
    assert len(EXAMPLES) == 5
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for page in EXAMPLES:
        text = page.read_text(encoding="utf-8")
        title, _, answer = text.split("\n")[:3]
        assert title.startswith('# "')
        assert answer.startswith("**"), page.name
        assert "**It is not** " in text, page.name
        assert text.count("\n") <= SCREEN, page.name
        assert f"(examples/{page.name})" in index
        assert f"\nexamples/{page.stem}\n" in index


def test_a_page_that_shows_what_is_not_printed_fails(tmp_path):
    page = tmp_path / "page.md"
    block = "```python\nprint('a b')\n```\n\n```text\n{}\n```\n"
    page.write_text(block.format("a b"), encoding="utf-8")
    run(page, tmp_path)
    page.write_text(block.format("a c"), encoding="utf-8")
    assert "a c" in run(page, tmp_path, code=1).stderr
