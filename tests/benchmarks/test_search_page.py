"""The search's page is made of its CSV."""

from __future__ import annotations

from benchmarks.learning.search import STUDY, page, read


def test_the_page_is_that_of_the_rows_beside_it(tmp_path):
    options = STUDY.parser().parse_args(["--out", str(tmp_path)])
    STUDY.write_page(options, **page(read(STUDY.folder / "search.csv")))
    made, kept = (folder / "search.md" for folder in (tmp_path, STUDY.folder))
    assert made.read_text("utf-8") == kept.read_text("utf-8")
