"""Pages of kept rows are what their scripts make of the rows."""

from __future__ import annotations

import csv
import importlib
from collections import Counter
from pathlib import Path

import pytest

from benchmarks.harness import ROOT
from tuning.search.stages import BELIEVED

FOLDER = ROOT / "benchmarks/learning"


@pytest.mark.parametrize("name", ["dither_tradeoff", "policies", "search", "treatments"])
def test_the_page_is_that_of_the_rows_beside_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("sys.argv", [name, "--out", str(tmp_path)])
    importlib.import_module(f"benchmarks.learning.{name}").main()
    made, kept = (folder / f"{name}.md" for folder in (tmp_path, FOLDER))
    assert made.read_text("utf-8") == kept.read_text("utf-8")
    assert [path.suffix for path in tmp_path.iterdir() if path != made] == [".png"]


def test_every_search_is_compared_with_the_default_that_wins_most_often():
    with (FOLDER / "treatments.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    (winner, _), *_ = Counter(x["treatment"] for x in rows if x["best"] == "1").most_common()
    assert winner in BELIEVED
