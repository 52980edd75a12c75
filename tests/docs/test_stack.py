"""The environments in other people's libraries, as the page shows them."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.docs.test_pages import DOCS, ROOT, run

PAGE = DOCS / "stack.md"
TEXT = PAGE.read_text(encoding="utf-8")
OTHERS = dict(
    zip(
        ("torchrl", "skrl"),
        re.findall(r"^```{code-block} python\n(.*?)^```", TEXT, re.M | re.S),
        strict=True,
    )
)


@pytest.mark.slow
def test_the_page_runs_and_prints_what_it_shows(tmp_path):
    pytest.importorskip("stable_baselines3")
    done = run(PAGE, tmp_path)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr}"


@pytest.mark.slow
@pytest.mark.parametrize("package", OTHERS)
def test_a_library_that_is_not_installed_here_prints_what_the_page_shows(package, tmp_path):
    pytest.importorskip(package)
    done = subprocess.run(
        [sys.executable, "-c", OTHERS[package]],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert f"It printed `{done.stdout.splitlines()[-1]}`" in TEXT
