"""Rows of other code are other rows: of what a benchmark depends on, and of nothing else."""

from __future__ import annotations

import importlib
from importlib import metadata
from pathlib import Path

import pytest

from benchmarks import _made_by
from benchmarks._made_by import made_by
from tests.test_architecture import FACADE, IMPORTS, SOURCES


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
    monkeypatch.setattr(_made_by, "ROOT", tmp_path)
    return tmp_path


PLACES = ("room", "study/*.py", "!study/*_page.py")


@pytest.mark.parametrize(
    "name", ["room/law.py", "room/settings.toml", "room/deeper/arm.xml", "study/rows.py"]
)
def test_a_file_of_a_place_that_changes_is_other_code(root: Path, name: str):
    before = made_by(PLACES)
    (root / name).write_text("changed", "utf-8")
    changed = made_by(PLACES)
    (root / name).unlink()
    (root / "room/more.py").write_text("new", "utf-8")
    assert len({before, changed, made_by(PLACES)}) == 3


@pytest.mark.parametrize("name", ["other.py", "study/rows_page.py", "room/curve.png"])
def test_what_is_in_no_place_or_taken_out_or_no_code_may_change(root: Path, name: str):
    before = made_by(PLACES)
    (root / name).write_text("changed", "utf-8")
    assert made_by(PLACES) == before


def test_a_renamed_file_is_other_code(root: Path):
    before = made_by(PLACES)
    (root / "room/law.py").rename(root / "room/laws.py")
    assert made_by(PLACES) != before


@pytest.mark.parametrize("place", ["rooms", "!study/*_figures.py", "room/curve.png"])
def test_a_place_where_nothing_is_raises(root: Path, place: str):
    with pytest.raises(ValueError, match="nothing is there"):
        made_by((*PLACES, place))


@pytest.mark.parametrize(("package", "packages"), [("mujoco", ()), ("torch", ("torch",))])
def test_another_version_is_other_code(
    root: Path, monkeypatch: pytest.MonkeyPatch, package: str, packages: tuple[str, ...]
):
    versions: dict[str, str] = {}
    monkeypatch.setattr(metadata, "version", lambda name: versions.get(name, "1"))
    before = made_by(PLACES, packages)
    versions[package] = "2"
    assert made_by(PLACES, packages) != before


# ---- the benchmarks' places ----------------------------------------------------------------------

DECIDES_NOTHING = ("stiction_envs.errors", "stiction_envs.version", "stiction_envs.reporting")
"""Words of errors, and the writers of files."""


@pytest.mark.parametrize(
    ("name", "places"),
    [
        ("_search_rows", "MEASURED_BY"),
        ("blind_logs", "MADE_BY"),
        ("real_logs", "MADE_BY"),
    ],
)
def test_places_have_all_that_is_imported(name: str, places: str):
    module = f"benchmarks.{name}"
    found = _made_by._files(getattr(importlib.import_module(module), places))
    assert {path for x in imported(module) if (path := SOURCES[x]) not in found} == set()


def imported(name: str) -> set[str]:
    """Return a module and all that it imports and that imports, but for pages and pictures."""
    out: set[str] = set()
    waiting = [name]
    while waiting:
        x = waiting.pop()
        shown = x.endswith(("_page", "_pictures", ".plots"))
        aside = shown or x == FACADE or x.startswith(DECIDES_NOTHING)
        if x not in out and not aside and x != "benchmarks._made_by":
            out.add(x)
            waiting += IMPORTS[x]
    return out
