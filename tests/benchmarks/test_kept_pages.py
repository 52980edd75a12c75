"""Pages of kept rows are what their scripts make of the rows."""

from collections import Counter
from pathlib import Path

import pytest

from benchmarks.harness import ROOT
from benchmarks.learning import kept_pages
from tests.command_line import csv_rows
from tuning.search.stages import BELIEVED

FOLDER = ROOT / "benchmarks/learning"


def test_pages_are_those_of_the_rows_beside_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.argv", ["kept_pages", "--out", str(tmp_path)])
    kept_pages.main()
    for name in kept_pages.PAGES:
        made, kept = (folder / f"{name}.md" for folder in (tmp_path, FOLDER))
        assert made.read_text("utf-8") == kept.read_text("utf-8")
    assert len(list(tmp_path.glob("*.png"))) == len(kept_pages.PAGES)


def test_every_search_is_compared_with_the_default_that_wins_most_often():
    rows = csv_rows(FOLDER / "treatments.csv")
    (winner, _), *_ = Counter(x["treatment"] for x in rows if x["best"] == "1").most_common()
    assert winner in BELIEVED
