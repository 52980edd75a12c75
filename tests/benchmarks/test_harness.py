"""Rows are kept until the code that decides them changes; a stopped study goes on."""

import importlib
from pathlib import Path

import pytest

from benchmarks import harness
from benchmarks.harness import Benchmark, code_digest
from tests.test_architecture import FACADE, SOURCES, imports


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a small project: a room with settings, a page, another room, a picture."""
    texts = {
        "room/law.py": "1",
        "room/settings.toml": "a = 1",
        "room/deeper/arm.xml": "<mujoco/>",
        "room/curve.png": "",
        "study/rows.py": "2",
        "study/rows_page.py": "3",
        "other.py": "4",
    }
    for name, text in texts.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    monkeypatch.setattr(harness, "ROOT", tmp_path)
    return tmp_path


PLACES = ("room", "study/*.py", "!study/*_page.py")


@pytest.mark.parametrize("name", ["room/deeper/arm.xml", "study/rows.py"])
def test_a_file_of_a_place_that_changes_is_other_code(root: Path, name: str):
    before = code_digest(PLACES)
    (root / name).write_text("changed", "utf-8")
    changed = code_digest(PLACES)
    (root / name).unlink()
    (root / "room/more.py").write_text("new", "utf-8")
    assert len({before, changed, code_digest(PLACES)}) == 3


@pytest.mark.parametrize("name", ["other.py", "study/rows_page.py", "room/curve.png"])
def test_what_is_in_no_place_or_taken_out_or_no_code_may_change(root: Path, name: str):
    before = code_digest(PLACES)
    (root / name).write_text("changed", "utf-8")
    assert code_digest(PLACES) == before


def test_a_page_is_written_beside_its_script_or_where_asked(tmp_path: Path):
    study = Benchmark(str(harness.ROOT / "benchmarks/speed/some.py"), "What it does.\n\nMore.")
    assert study.command == "python -m benchmarks.speed.some"
    assert study.parser().parse_args([]).out == harness.ROOT / "benchmarks/speed"
    options = study.parser().parse_args(["--out", str(tmp_path / "new")])
    study.write_page(options, "# Title\n\nText\n\n")
    assert (tmp_path / "new/some.md").read_text("utf-8") == "# Title\n\nText\n"


# ---- the benchmarks' places ----------------------------------------------------------------------

DECIDES_NOTHING = tuple(f"stiction_envs.{x}" for x in ("arrays", "errors", "reporting", "version"))
"""Types of arrays, words of errors, and the writers of files."""


def test_places_have_all_that_is_imported():
    module = "benchmarks.accuracy.blind_logs"
    found = harness.files_of(importlib.import_module(module).MADE_BY)
    assert {path for x in imported(module) if (path := SOURCES[x]) not in found} == set()


def imported(name: str) -> set[str]:
    """Return a module and all that it imports and that imports, but for pages and pictures."""
    out: set[str] = set()
    waiting = [name]
    while waiting:
        x = waiting.pop()
        shown = x.endswith(("_page", "_pictures", ".plots"))
        aside = shown or x == FACADE or x.startswith(DECIDES_NOTHING)
        if x not in out and not aside and x != "benchmarks.harness":
            out.add(x)
            waiting += imports()[x]
    return out
