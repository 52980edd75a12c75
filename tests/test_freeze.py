"""A few results of every room are the numbers that `benchmarks/freeze.json` keeps."""

import json
from typing import Any

import pytest

from benchmarks.freeze import QUICK, TOLERANCE, changed, quick


@pytest.fixture(scope="module")
def now() -> dict[str, Any]:
    return quick()


@pytest.mark.parametrize("name", TOLERANCE)
def test_results_are_as_before(now: dict[str, Any], name: str):
    """If a change of results is wanted: ``python -m benchmarks.freeze --write-quick``."""
    before = json.loads(QUICK.read_text("utf-8"))
    mine = {key: value for key, value in now.items() if key.split()[0] == name}
    kept = {key: value for key, value in before.items() if key.split()[0] == name}
    assert mine
    assert changed(mine, kept, TOLERANCE[name]) == []


def test_a_difference_is_told_by_its_place():
    before = {"torques": [1.0, 2.0], "verdict": "explained"}
    assert changed({"torques": [1.0, 2.0 + 1e-12], "verdict": "explained"}, before, 1e-9) == []
    assert changed({"torques": [1.0, 2.1], "verdict": "cannot tell"}, before, 1e-9) == [
        "torques [1]: 2.0 before, 2.1 now",
        "verdict: explained before, cannot tell now",
    ]
    assert len(changed({"torques": [1.0]}, before, 1e-9)) == 1
    assert len(changed({"torques": [1.0], "verdict": "explained"}, before, 1e-9)) == 1
