"""The three ways in: a picture first, few lines to type, and every block runs and prints as shown."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def load(name):
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


run_page, make_pictures = load("run_page"), load("make_pictures")
PAGES = sorted(make_pictures.WRITTEN_BY)


def run(page, folder):
    return subprocess.run(
        [sys.executable, DOCS / "run_page.py", page, folder],
        env={"MUJOCO_GL": "egl", **os.environ},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("page", PAGES)
def test_a_page_begins_with_a_picture_and_three_lines_to_type(page):
    lines = (DOCS / f"{page}.md").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# ")
    assert lines[2].startswith("![")
    first = next(k for k, line in enumerate(lines) if line.startswith("```"))
    assert first < 8
    assert lines[first + 4] == "```"


@pytest.mark.parametrize("page", PAGES)
def test_a_page_ends_with_what_can_go_wrong_and_when_not_to_use_it(page):
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    heads = [line[3:] for line in text.splitlines() if line.startswith("## ")]
    assert "How far to trust it" in heads
    assert heads[-2:] == ["What can go wrong", "When not to use it"]


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_a_page_runs_and_prints_what_it_shows(page, tmp_path):
    done = run(DOCS / f"{page}.md", tmp_path)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr}"
    for name, source in make_pictures.WRITTEN_BY[page].items():
        made, shown = (Image.open(x).size for x in (tmp_path / source, DOCS / name))
        assert made == shown, f"{name} is not what the page makes: python docs/make_pictures.py"


def test_a_page_that_shows_what_is_not_printed_fails(tmp_path):
    page = tmp_path / "page.md"
    block = "```python\nprint('a b')\n```\n\n```text\n{}\n```\n"
    page.write_text(block.format("a b"), encoding="utf-8")
    assert run(page, tmp_path).returncode == 0
    page.write_text(block.format("a c"), encoding="utf-8")
    done = run(page, tmp_path)
    assert done.returncode == 1
    assert "a c" in done.stderr


def test_a_command_that_fails_fails_the_page(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```console\n$ stiction check none.csv\n```\n", encoding="utf-8")
    done = run(page, tmp_path)
    assert done.returncode
    assert "none.csv" in done.stderr
