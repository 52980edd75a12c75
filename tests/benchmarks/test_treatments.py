"""Treatments side by side: the page is that of the rows."""

from __future__ import annotations

from collections import Counter

from benchmarks.learning.treatments import STUDY, page, read_rows
from tuning.search.stages import BELIEVED


def test_the_page_is_that_of_the_rows_beside_it(tmp_path):
    lines, searched = (
        read_rows(STUDY.folder / f"{name}.csv") for name in ("treatments", "treatments_searched")
    )
    options = STUDY.parser().parse_args(["--out", str(tmp_path)])
    STUDY.write_page(options, **page(lines, searched))
    made, kept = (folder / "treatments.md" for folder in (tmp_path, STUDY.folder))
    assert made.read_text("utf-8") == kept.read_text("utf-8")


def test_every_search_is_compared_with_the_default_that_wins_most_often():
    rows = read_rows(STUDY.folder / "treatments.csv")
    (winner, _), *_ = Counter(x["treatment"] for x in rows if x["best"] == "1").most_common()
    assert winner in BELIEVED
