"""Treatments side by side: what a hand feels, and what the page says of a row."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.learning.treatments import STEP_M, STUDY, hold_and_push
from benchmarks.learning.treatments_page import best, page, searched_page
from benchmarks.learning.treatments_plan import PENTAGON, Condition, conditions, random_places
from stiction_envs.control.compensation import KINDS
from stiction_envs.control.trajectory import Path
from stiction_envs.reporting.templates import render
from tests.experiments.gte.short_paths import SOFT, bench, friction
from tuning.search.tracking import Treatment

STEP = Path("step", np.array([[STEP_M, 0, 0]]), np.array([[1.0, 0, 0, 0]]))


def test_a_hand_feels_the_chosen_stiffness_and_friction_on_top():
    """Without friction the 200 N/m that were chosen; with it more, and a still arm before."""
    felt = {}
    for kind in ("none", "rigid"):
        b = bench(kind=kind, paths={"step": STEP}, scatter=False, threads=1)
        found = hold_and_push(b, {"nothing": Treatment()}, SOFT, friction(kind=kind))[0]
        felt[kind] = found["push_n_per_m"]
    # of the arm that sticks; without friction and little damping it still swings after the step
    assert found["hold_m"] < 1e-6
    assert found["creep_m_s"] < 1e-6
    assert felt["none"] == pytest.approx(200.0, rel=0.1)
    assert felt["rigid"] > 1.2 * felt["none"]


def test_conditions_are_distinct_and_ideal_ones_need_no_senses():
    listed = conditions("panda")
    assert len(set(listed)) == len(listed)
    assert sum(c.delay_ms is None for c in listed) == 6


def numbers(left: float, rest: float = 2e-5, swings: float = 0.0) -> dict[str, float]:
    """What a treatment did that leaves so much of the error and shakes so much at rest [m]."""
    out = {"position_left": left, "orientation_left": left, "vibration_m": 1e-4}
    out |= {"left_by_path": [float(np.log(left))] * 4, "rest_error_m": 2e-3}
    out |= {"vibration_at_rest_m": rest, "torque_rate_nm_s": 500.0, "creep_m_s": 0.0}
    return out | {"hold_m": swings, "hold_hz": 0.0, "push_n_per_m": 300.0}


def test_the_best_treatment_neither_shakes_nor_hunts_at_rest():
    row = {
        "seconds": 1.0,
        "nothing": numbers(1.0),
        "dither": numbers(0.2, rest=5e-5),
        "lugre_observer": numbers(0.1, swings=0.02),
        "push": numbers(0.6),
    }
    assert best(row) == "push"
    row["dither"] = numbers(0.2, rest=3.9e-5)
    assert best(row) == "dither"
    row["push"] = row["dither"] = numbers(1.5)
    assert best(row) == "nothing"


def test_the_page_holds_every_treatment():
    names = ("nothing", "dither", *KINDS)
    row = {"seconds": 1.0, **{name: numbers(0.01 * (k + 1)) for k, name in enumerate(names)}}
    condition = Condition(robot="panda", stiffness=SOFT, friction=1 / 0.7)
    values = {**page({condition: row}, 6), "found": {}}
    text = render(STUDY.folder / "treatments.md.j2", command=STUDY.command, **values)
    assert "1 of 6 conditions" in text
    assert "## panda, 200 N/m, friction believed -30 %, ideal senses" in text
    for k, name in enumerate(names):
        assert f"| {name} | {k + 1} | {k + 1} | 0.1000 |" in text
    assert "## Searched gains" not in text


def test_the_page_holds_searched_gains_beside_the_defaults():
    """The best of all on random paths; what shakes at rest is not, however little it leaves."""
    row = {"nothing": numbers(1.0), "dither": numbers(0.8), "push": numbers(0.6)}
    row |= {"dither, searched": numbers(0.1, rest=5e-5), "push, searched": numbers(0.25)}
    condition = Condition(robot="panda", stiffness=SOFT, delay_ms=1.0)
    judged = {(condition, PENTAGON): {**row, "push, searched": numbers(0.35)}}
    judged[condition, random_places(50)] = row
    found = searched_page(judged, [{"evaluations": 96}])
    values = {**page({condition: row}, 6), "found": found}
    text = render(STUDY.folder / "treatments.md.j2", command=STUDY.command, **values)
    assert "same budget, 96 trials" in text
    assert "on 50 random paths and 8 runs of the pentagon" in text
    name = "panda, 200 N/m, friction known, senses 1 ms late, noise × 1"
    one, other = "push | 60 / 60 | 60 (60 to 60)", "push, searched | 25 / 25 | 25 (25 to 25)"
    assert f"| {name} | {one} | {other} | push, searched |" in text
    assert "| push, searched | 25 / 25 | 25 (25 to 25) | 35 / 35 | 0.020 |" in text
