"""What the search's page says of a longer search is what its rows say."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.learning.search import STUDY
from benchmarks.learning.search_page import LONGER, LOOKS, Measured, _changes, draw, page

KNOWN, ELSEWHERE = "friction known", "other start poses"


def measured(longer: float, other: float, elsewhere: float) -> Measured:
    """Return errors left at rest of three tables: 0.3, and what is asked for."""

    def rows(more: float) -> dict[str, dict[str, float]]:
        left = {"search, constant": 0.3, LONGER[0]: longer, LONGER[1]: other}
        parts = ("resting_position", "resting_orientation")
        return {name: dict.fromkeys(parts, x + more) for name, x in left.items()}

    return {
        KNOWN: {"triangle": rows(0.0)},
        "friction believed too small": {"triangle": rows(5.0)},  # not looked at
        ELSEWHERE: {"triangle": rows(elsewhere)},
    }


def test_what_a_longer_search_wins_is_held_against_seed_and_start():
    found = _changes(measured(longer=0.28, other=0.33, elsewhere=-0.1))
    assert found == pytest.approx({"longer": 2.0, "seed": 5.0, "start": 10.0})


def test_a_longer_search_may_lose():
    assert _changes(measured(0.31, 0.31, 0.0))["longer"] == pytest.approx(-1.0)


def test_changes_of_both_signs_do_not_cancel():
    found = measured(0.2, 0.2, 0.0)
    other = found[KNOWN]["triangle"][LONGER[1]]
    other["resting_position"], other["resting_orientation"] = 0.1, 0.3
    assert _changes(found)["seed"] == pytest.approx(5.0)
    start = found[ELSEWHERE]["triangle"][LONGER[0]]
    start["resting_position"], start["resting_orientation"] = 0.1, 0.3
    assert _changes(found)["start"] == pytest.approx(10.0)


def test_the_page_holds_every_treatment(tmp_path: Path):
    parts = [f"{x}{part}" for x in ("", "resting_") for part in ("position", "orientation")]
    row = dict.fromkeys((*parts, "vibration_m", "vibration_at_rest_m"), 0.5)
    names = (*LOOKS, "the same without its gate")
    conditions = (KNOWN, "believed too small", "believed too large", ELSEWHERE)
    results = {path: {name: row for name in names} for path in ("triangle", "pentagon")}
    panda = {condition: results for condition in conditions}
    joint = [{"left": 0.9, "displacement_rad": 1e-3}] * 7
    tables = {"make tune": joint, "search": joint}
    values = page(
        paths={"panda": panda, "iiwa7": {KNOWN: results}, "iiwa14": {KNOWN: results}},
        joints={"panda": tables, "iiwa7": tables, "iiwa14": tables},
        hunting={"0.05 mrad": [1e-4]},
        gains=[1.0],
    )
    options = STUDY.parser().parse_args(["--out", str(tmp_path)])
    more = {"seed": 1, "iterations": 1, "evaluations": 1600, "gates_rad_s": [0.1, 0.2]}
    text = STUDY.write_page(options, **values, **more)
    assert all(f"| {name} | 50 | 50 |" in text for name in names)
    draw(panda, tmp_path / "compensation.png")
    assert (tmp_path / "compensation.png").exists()
