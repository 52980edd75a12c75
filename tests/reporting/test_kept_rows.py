"""Work that was stopped goes on where it was, and other code does it anew."""

from pathlib import Path
from typing import Any

import pytest

from stiction_envs.reporting.kept_rows import KeptRows


def test_what_was_stopped_goes_on_and_other_code_measures_anew(tmp_path: Path):
    asked: list[int | None] = []
    heard: list[tuple[str, int, int]] = []

    def square(x: int) -> dict[str, Any]:
        if x == 3 and len(asked) == 2:
            asked.append(None)
            raise KeyboardInterrupt
        asked.append(x)
        return {"square": x * x}

    path, jobs = tmp_path / "new" / "rows.jsonl", {str(x): x for x in (1, 2, 3)}
    with pytest.raises(KeyboardInterrupt):
        KeptRows(path, "code").fill(jobs, square)
    path.write_text(path.read_text("utf-8") + '{"key": "3", "ro', "utf-8")  # of a killed run
    for _ in range(2):
        rows = KeptRows(path, "code").fill(jobs, square, tell=lambda *x: heard.append(x))
        assert [row["square"] for row in rows.values()] == [1, 4, 9]
    assert asked == [1, 2, None, 3]
    assert heard == [("3", 3, 3)]
    assert not KeptRows(path, "other code").fill(jobs, square, minutes=0)
    KeptRows(path, "other code").fill({"1": 1}, square)
    assert asked[4:] == [1]
    assert set(KeptRows(path, "code").every) == {"1", "2", "3"}
    assert KeptRows(None).fill({"4": 4}, square) == {"4": {"square": 16}}


@pytest.mark.slow
def test_processes_measure_what_one_would():
    assert KeptRows(None).fill({"a": -1.0, "b": 2.0}, abs, processes=2) == {"a": 1.0, "b": 2.0}
