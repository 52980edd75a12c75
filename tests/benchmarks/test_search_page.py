"""What the search's page says of a longer search is what its rows say."""

from __future__ import annotations

import pytest

from benchmarks._search_page import LONGER, Measured, _changes

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
