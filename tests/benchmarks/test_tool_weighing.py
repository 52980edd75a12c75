"""The study of tools that are weighed with an earlier session's model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.accuracy.tool_weighing import (
    DISTANCE,
    HALF_WIDTH,
    MASS,
    STUDY,
    Job,
    inside,
    page,
    weigh,
)


def row(mass: float, weighed: float = 0.0, half_width: float = 0.1, **more: Any) -> Any:
    """Return a row as `weigh` makes it; without a payload where nothing was weighed."""
    out = {
        "seed": 1,
        "mass_kg": mass,
        "friction": False,
        "exciting": True,
        "motion": "fast",
        "calibration": {"named": []},
        "named": [],
        "seconds": 9.0,
    }
    ci = [weighed - half_width * mass, weighed + half_width * mass]
    found = {
        "named": ["payload"],
        "weighed_kg": weighed,
        "ci95_kg": ci,
        "inside": ci[0] <= mass <= ci[1],
        "half_width": half_width,
        "com_inside": True,
    }
    return out | (found if weighed else {}) | more


def test_a_tool_that_is_not_named_is_not_within_the_interval(tmp_path: Any) -> None:
    rows = [row(0.5), row(2.0, 2.1), row(2.0, 3.0), row(1.5, 1.5, 0.3), row(1.0, broken="no")]
    assert [inside(x) for x in rows[:4]] == [False, True, False, True]
    values = page({str(k): x for k, x in enumerate(rows)})
    counts = {k: values[k] for k in ("cases", "broken", "hits", "narrow", "heavy")}
    assert counts == {"cases": 4, "broken": 1, "hits": 2, "narrow": 2, "heavy": 3}
    last = values["table"].splitlines()[-1]
    assert last == "| all | 4 | 3 | 2 | 3 | 5.0 | 50.0 | 10.0 | 30.0 |"
    options = STUDY.parser().parse_args(["--out", str(tmp_path)])
    text = STUDY.write_page(options, planned=5, **values)
    assert "In 2 of 4 cases" in text
    assert "(aim ≥ 90 %: missed); from 1 kg up 2 of 3 intervals" in text
    missed = "- 1, 0.50 kg (fast, without friction, calibrated: exciting logs): named nothing"
    assert f"{missed}; on the bare arm nothing" in text


def test_tools_are_as_heavy_and_as_far_out_as_said() -> None:
    tools = [Job(seed).tool() for seed in range(200)]
    masses = np.array([m for m, _ in tools])
    far = np.array([np.linalg.norm(c) for _, c in tools])
    for values, low, high in ((masses, *MASS), (far, 0.0, DISTANCE)):
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.1 * (high - low) < values.max() <= high


def test_half_of_the_arms_are_calibrated_on_exciting_logs() -> None:
    kinds = {(j.exciting, j.seed % 2, j.seed % 3) for j in map(Job, range(12))}
    assert len(kinds) == 12


@pytest.mark.slow
def test_a_tool_is_weighed_with_the_model_of_the_bare_arm() -> None:
    found = weigh(Job(4))
    assert found["mass_kg"] > 1
    assert inside(found)
    assert found["half_width"] <= HALF_WIDTH
