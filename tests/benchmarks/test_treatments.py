"""Treatments side by side: what a hand feels, which one is best, and the page of the rows."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from benchmarks.learning.treatments import (
    STEP_M,
    STUDY,
    best,
    conditions,
    hold_and_push,
    page,
    read_rows,
)
from stiction_envs.control.trajectory import Path
from tests.experiments.gte.short_paths import SOFT, bench, friction
from tuning.search.stages import BELIEVED
from tuning.search.tracking import Treatment

STEP = Path("step", np.array([[STEP_M, 0, 0]]), np.array([[1.0, 0, 0, 0]]))


@pytest.mark.slow
def test_a_hand_feels_the_chosen_stiffness_and_friction_on_top():
    """Without friction the 200 N/m that were chosen; with it more, and a still arm before."""
    felt = {}
    for kind in ("none", "rigid"):
        b = bench(kind=kind, paths={"step": STEP}, scatter=False, threads=1)
        found = hold_and_push(b, {"nothing": Treatment()}, SOFT, friction(kind=kind))[0]
        felt[kind] = found["push_n_per_m"]
    # of the arm that sticks; without friction and little damping it still swings after the step
    assert found["swing_mm"] < 1e-3
    assert found["creep_mm_s"] < 1e-3
    assert felt["none"] == pytest.approx(200.0, rel=0.1)
    assert felt["rigid"] > 1.2 * felt["none"]


def numbers(left: float, rest: float = 0.02, swing: float = 0.0) -> dict[str, float]:
    """Return what a treatment did that leaves so much of the error [%] and shakes so [mm]."""
    out = {"position_percent": left, "orientation_percent": left}
    return out | {"vibration_at_rest_mm": rest, "swing_mm": swing}


def test_the_best_treatment_neither_shakes_nor_hunts_at_rest():
    row = {
        "nothing": numbers(100.0),
        "dither": numbers(20.0, rest=0.05),
        "lugre_observer": numbers(10.0, swing=20.0),
        "push": numbers(60.0),
    }
    assert best(row) == "push"
    row["dither"] = numbers(20.0, rest=0.039)
    assert best(row) == "dither"
    row["push"] = row["dither"] = numbers(150.0)
    assert best(row) == "nothing"


def test_the_page_is_that_of_the_rows_beside_it(tmp_path):
    lines, searched = (
        read_rows(STUDY.folder / f"{name}.csv") for name in ("treatments", "treatments_searched")
    )
    assert len({tuple(line.values())[:6] for line in lines}) == 3 * len(conditions("panda"))
    options = STUDY.parser().parse_args(["--out", str(tmp_path)])
    STUDY.write_page(options, **page(lines, searched))
    made, kept = (folder / "treatments.md" for folder in (tmp_path, STUDY.folder))
    assert made.read_text("utf-8") == kept.read_text("utf-8")


def test_every_search_is_compared_with_the_default_that_wins_most_often():
    rows = read_rows(STUDY.folder / "treatments.csv")
    (winner, _), *_ = Counter(x["treatment"] for x in rows if x["best"] == "1").most_common()
    assert winner in BELIEVED
