"""Rows are kept until the code that decides them changes; a stopped study goes on."""

from __future__ import annotations

import importlib
from importlib import metadata
from pathlib import Path

import pytest

from benchmarks import harness
from benchmarks.harness import Benchmark, Rows, code_digest
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


@pytest.mark.parametrize("place", ["rooms", "!study/*_figures.py", "room/curve.png"])
def test_a_place_where_nothing_is_raises(root: Path, place: str):
    with pytest.raises(ValueError, match="nothing is there"):
        code_digest((*PLACES, place))


def test_another_version_is_other_code(root: Path, monkeypatch: pytest.MonkeyPatch):
    versions: dict[str, str] = {}
    monkeypatch.setattr(metadata, "version", lambda name: versions.get(name, "1"))
    before = code_digest(PLACES)
    versions["mujoco"] = "2"
    assert code_digest(PLACES) != before


# ---- rows ----------------------------------------------------------------------------------------


def test_a_study_that_was_stopped_goes_on_and_other_code_measures_anew(tmp_path: Path):
    asked = []

    def square(x: int) -> harness.Row:
        if x == 3 and len(asked) == 2:
            asked.append(None)
            raise KeyboardInterrupt
        asked.append(x)
        return {"square": x * x}

    path, jobs = tmp_path / "rows.jsonl", {str(x): x for x in (1, 2, 3)}
    with pytest.raises(KeyboardInterrupt):
        Rows(path, "code").fill(jobs, square)
    path.write_text(path.read_text("utf-8") + '{"key": "3", "ro', "utf-8")  # of a killed run
    for _ in range(2):
        rows = Rows(path, "code").fill(jobs, square)
        assert [row["square"] for row in rows.values()] == [1, 4, 9]
        assert all(row["seconds"] >= 0 for row in rows.values())
    assert asked == [1, 2, None, 3]
    assert not Rows(path, "other code").fill(jobs, square, minutes=0)
    Rows(path, "other code").fill({"1": 1}, square)
    assert asked[4:] == [1]
    assert set(Rows(path, "code").every) == {"1", "2", "3"}


@pytest.mark.slow
def test_processes_measure_what_one_would(tmp_path: Path):
    jobs = {"a": -1.0, "b": 2.0}
    rows = Rows(tmp_path / "rows.jsonl", "").fill(jobs, absolute, processes=2)
    assert {key: row["value"] for key, row in rows.items()} == {"a": 1.0, "b": 2.0}


def absolute(x: float) -> harness.Row:
    return {"value": abs(x)}


def test_a_page_is_written_beside_its_script_or_where_asked(tmp_path: Path):
    study = Benchmark(str(harness.ROOT / "benchmarks/speed/some.py"), "What it does.\n\nMore.")
    assert study.command == "python -m benchmarks.speed.some"
    assert study.parser().parse_args([]).out == harness.ROOT / "benchmarks/speed"
    options = study.parser().parse_args(["--out", str(tmp_path / "new")])
    study.write_page(options, "# Title\n\nText\n\n")
    assert (tmp_path / "new/some.md").read_text("utf-8") == "# Title\n\nText\n"


# ---- the benchmarks' places ----------------------------------------------------------------------

DECIDES_NOTHING = ("stiction_envs.errors", "stiction_envs.version", "stiction_envs.reporting")
"""Words of errors, and the writers of files."""


@pytest.mark.parametrize("name", ["blind_logs", "real_logs"])
def test_places_have_all_that_is_imported(name: str):
    module = f"benchmarks.accuracy.{name}"
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
