"""The site builds without a warning, asks nothing of a network and has a page for everything."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest

import stiction_envs
from stiction_envs.cli.dispatch import COMMANDS

pytest.importorskip("sphinx")
ROOT = Path(__file__).parents[2]
# what a browser fetches by itself when it shows a page
FETCHED = re.compile(
    r"<(?:script|img|iframe|source)[^>]*\ssrc=\"([^\"]*)|<link[^>]*\shref=\"([^\"]*)"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "docs"]
    done = subprocess.run([*command, folder], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
def test_nothing_is_fetched_from_a_network(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        for pair in FETCHED.findall(page.read_text(encoding="utf-8")):
            assert not re.match(r"(https?:)?//", "".join(pair)), f"{page.name}: {pair}"


@pytest.mark.slow
def test_every_command_and_environment_has_a_page(site):
    assert stiction_envs.__version__
    ours = [n for n, s in gymnasium.registry.items() if "stiction_envs" in str(s.entry_point)]
    assert len(ours) >= 4
    for name in ours:
        assert (site / "generated" / "environments" / f"{name}.html").is_file()
    for module in COMMANDS:
        name = module.__name__.rpartition(".")[2]
        assert (site / "generated" / "commands" / f"{name}.html").is_file()
