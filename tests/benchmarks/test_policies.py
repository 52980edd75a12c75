"""The page of the policies is made of its rows."""

from __future__ import annotations

from pathlib import Path

from benchmarks.learning.policies import BASELINE, ROWS, STUDY, page


def test_the_page_is_made_of_the_rows(tmp_path: Path):
    options = STUDY.parser().parse_args(["--out", str(tmp_path)])
    text = STUDY.write_page(options, **page(ROWS, tmp_path))
    assert (tmp_path / "policies.md").read_text() == (ROWS.parent / "policies.md").read_text()
    assert f"| {BASELINE} | –" in text
    assert (tmp_path / "policies.png").is_file()
