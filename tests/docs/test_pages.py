"""Every command in a `console` block of the three ways in runs as it is printed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = ("panda", "log", "policies")


def commands(page: str) -> list[str]:
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    lines = [
        line
        for block in re.findall(r"```console\n(.*?)```", text, re.S)
        for line in block.splitlines()
    ]
    return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]


@pytest.mark.parametrize("page", PAGES)
def test_a_page_begins_with_a_picture_and_few_commands(page):
    lines = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# ")
    assert lines[2].startswith("![")
    assert 1 <= len(commands(page)) <= 3


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_its_commands_run(page, tmp_path):
    code = "import sys; from stiction_envs.cli import main; sys.exit(main(sys.argv[1:]))"
    for command in commands(page):
        program, *words = command.split()
        assert program == "stiction"
        done = subprocess.run(
            [sys.executable, "-c", code, *words],
            cwd=tmp_path,
            env=dict(os.environ, PYTHONPATH=str(ROOT)),
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
