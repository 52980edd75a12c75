"""The ensemble of Table 4.11: intervals, coverage, what would settle it, and what is said."""

import csv
import dataclasses
import json

import numpy as np
import pytest

from stiction_envs.thesis.ensemble import (
    NO_DITHER,
)
from stiction_envs.thesis.ensemble_page import plot_ensemble, write_ensemble
from stiction_envs.thesis.ensemble_prior import (
    bare_arm,
    joint_speeds,
)
from stiction_envs.thesis.ensemble_scores import (
    coverage,
    dither_speed,
    factor,
    friction_gone,
    friction_left,
    inside,
    intervals,
    lag,
    measured_sums,
    pairs_needed,
    repeats_needed,
    scores,
    signs_right,
    stack,
)
from tests.thesis.made_up_ensemble import SET_UP, made_up

# ---- what is made of it --------------------------------------------------------------------------


def test_intervals_are_numpys_quantiles():
    values = np.random.default_rng(0).normal(size=(41, 24))
    ends = intervals(values)
    ordered = np.sort(values, axis=0)
    # 40 gaps: every quantile falls on a value
    np.testing.assert_allclose(ends, ordered[[2, 10, 20, 30, 38]])
    np.testing.assert_array_equal(inside(ends, ordered[10]), [np.ones(24, bool), np.ones(24, bool)])
    assert not inside(ends, ordered[10] - 1e-9)[0].any()
    assert inside(ends, ordered[2])[1].all()
    assert not inside(ends, ordered[2] - 1e-9)[1].any()


def test_a_table_from_the_ensemble_is_covered_as_often_as_it_should():
    rng = np.random.default_rng(1)
    values = rng.normal(size=(200, 24))
    ends = intervals(values)
    half, most = np.mean(
        [inside(ends, rng.normal(size=24)).sum(axis=1) for _ in range(200)], axis=0
    )
    assert half == pytest.approx(12.0, abs=1.0)
    assert most == pytest.approx(21.6, abs=0.6)
    # a set-up of the ensemble held against the others: what 24 coins give
    own = coverage(values, np.zeros(24))
    assert own.own_50[1] == pytest.approx(12, abs=1)
    assert (own.own_90[0], own.own_90[2]) == (pytest.approx(19, abs=1), pytest.approx(24, abs=0.1))


def test_a_table_from_elsewhere_is_seldom_covered():
    values = np.random.default_rng(2).normal(size=(100, 24))
    far = coverage(values, np.full(24, 4.0))
    assert (far.in_50, far.in_90) == (0, 0)
    assert far.own_90[0] > far.in_90
    assert (far.as_few, far.set_ups) == (0, 100)
    assert coverage(values, values[0]).as_few > 5
    # cells that hang together are inside or outside together
    together = coverage(values[:, :1] + np.zeros(24), np.zeros(24))
    assert together.in_50 == 24
    assert (together.own_50[0], together.own_50[2]) == (0, 24)


def test_scores_of_known_numbers():
    before, after = measured_sums()
    change = np.log(after / before)
    falls = np.full((1, 24), -0.1)
    assert signs_right(falls, change)[0] == 19
    assert signs_right(change[None], change)[0] == 24
    assert factor(2.0 * before[None], before)[0] == pytest.approx(2.0)
    assert lag(0.4 * before[None], before[None])[0] == pytest.approx(0.4)
    # an effect as large as two standard errors of eight pairs
    assert pairs_needed(np.array(1.0), np.array(1.0)) == 8
    assert pairs_needed(np.array(-0.1), np.array(0.1)) == 8
    assert pairs_needed(np.array(0.05), np.array(0.1)) == 32


def test_averaging_frees_a_slow_joint_and_no_fast_one():
    assert friction_left(np.array(1e-9), np.array(0.1)) == pytest.approx(0.0, abs=1e-6)
    assert friction_left(np.array(0.05), np.array(0.1)) == pytest.approx(1 / 3)
    assert friction_left(np.array(0.2), np.array(0.1)) == 1.0
    # joint 7 has no spring: amplitude over inertia times angular frequency
    p = bare_arm().parameters
    rigid = 0.8041 / (p.rotor_inertia[6] * 2 * np.pi * 15.0)
    assert dither_speed(p)[6] == pytest.approx(rigid, rel=1e-3)
    # joint 1 is above the resonance of its rotor: the spring makes the rotor shake more
    omega = 2 * np.pi * 50.0
    spring = p.joint_stiffness[0] - p.rotor_inertia[0] * omega**2
    assert dither_speed(p)[0] == pytest.approx(-0.85 * omega / spring)


def test_joints_turn_as_fast_as_the_path_asks():
    slow = dataclasses.replace(SET_UP, speed=0.1, acceleration=0.4)
    fast = dataclasses.replace(slow, speed=0.2)
    np.testing.assert_allclose(joint_speeds(fast), 2 * joint_speeds(slow))
    # never as fast as the limit: half a side at constant acceleration
    short = dataclasses.replace(slow, speed=0.5, triangle_side=0.1)
    np.testing.assert_allclose(joint_speeds(short), 2 * joint_speeds(slow))


def test_stacked_sums_tell_dither_from_session():
    members = [made_up(k) for k in range(8)]
    sums = stack(members)
    before, after = measured_sums()
    assert sums.no_dither.shape == (8, 24)
    np.testing.assert_allclose(np.median(sums.by_session), np.log(1.02), atol=0.02)
    np.testing.assert_allclose(sums.change, sums.by_dither + sums.by_session)
    np.testing.assert_allclose(np.median(sums.change, axis=0), np.log(after / before), atol=0.12)
    assert np.sqrt((sums.scatter**2).mean()) == pytest.approx(0.05, rel=0.2)
    # means of 24 independent cells
    assert np.sqrt((sums.scatter_of_mean**2).mean()) == pytest.approx(0.05 / np.sqrt(24), rel=0.5)


# ---- files ---------------------------------------------------------------------------------------


def test_files_follow_the_numbers(tmp_path):
    members = [made_up(k) for k in range(30)]
    shipped = {"diagonal": 0.51, "mass": 0.83}
    text, found = write_ensemble(tmp_path, members, shipped)
    assert {p.name for p in tmp_path.iterdir()} == {"ensemble.csv", "ensemble.png"}
    with open(tmp_path / "ensemble.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 30
    assert float(rows[3]["start_4"]) == SET_UP.start[3]
    assert rows[0]["hand"] == SET_UP.hand
    mean = members[3].sums[NO_DITHER, 2].mean(axis=0)
    assert float(rows[3]["no_dither_pentagon_200_roll"]) == mean[3]
    assert float(rows[3]["signs_right_two_sessions"]) <= 24
    assert (tmp_path / "ensemble.png").stat().st_size > 20_000
    assert json.loads(json.dumps(found))["sums"]["in_90"] == found["sums"]["in_90"]
    assert "30 set-ups" in text
    assert '"Every error falls", which looks at nothing, has 19 of 24' in text
    assert "51 %" in text
    assert "83 %" in text
    assert f"{found['sums']['in_50']} of 24 measured sums lie in the 50 % interval" in text
    assert "sums without dither are such as one of these set-ups may have" in text
    named = text.split("Outside the 90 %: ")[1].split(" (no dither)")[0]
    found_outside = 0 if named == "no cell" else len(named.replace(" and ", ", ").split(", "))
    assert found_outside == 24 - found["sums"]["in_90"]
    # every set-up has the measured signs, but for the small ones
    assert found["kinds"]["both"]["above_falls"] > 15

    # beyond the 50 % on one side, within the 90 %: still inside
    beside = [dataclasses.replace(m, sums=1.3 * m.sums) for m in members]
    (tmp_path / "beside").mkdir()
    text, found = write_ensemble(tmp_path / "beside", beside, shipped)
    assert found["sums"]["in_50"] < found["sums"]["in_90"] == 24
    assert "Outside the 90 %: no cell (no dither)" in text

    other = [dataclasses.replace(m, sums=9.0 * m.sums) for m in members]
    (tmp_path / "other").mkdir()
    text, found = write_ensemble(tmp_path / "other", other, shipped)
    assert "0 of 24 measured sums lie in the 50 % interval and 0 in the 90 %; with it 0" in text
    assert "Outside the 90 %: triangle 200 x, triangle 200 y," in text
    assert "0 of 30 have no more than 0" in text
    assert "the prior or the model lacks something that the measured sums without" in text
    assert found["size"]["median"] == pytest.approx(9.0, rel=0.1)


def test_what_explains_the_change_is_said_by_the_numbers(tmp_path):
    def with_factors(dither, session):
        factors = np.array([1.0, dither * session, session, 0.5])[:, None, None, None]
        flat = [np.array([m.sums[NO_DITHER]] * 4) * factors for m in (made_up(0), made_up(1))]
        return [dataclasses.replace(made_up(k), sums=flat[k]) for k in (0, 1)]

    for dither, session, said in ((0.7, 1.01, False), (1.01, 0.7, True)):
        found = scores(with_factors(dither, session), measured_sums(), fitting=0.5)
        assert found["kinds"]["dither"]["reach"] == (0 if said else 2)
        assert found["kinds"]["session"]["reach"] == (2 if said else 0)
        assert found["kinds"]["both"]["reach"] == 2


def test_less_friction_explains_a_change_in_proportion():
    fall = np.full(24, np.log(0.9))
    np.testing.assert_allclose(friction_gone(fall, np.array([0.0, 0.5, 0.95])), [0.1, 0.2, 2.0])
    assert friction_gone(fall, np.array([1.1])) == np.inf
    assert repeats_needed(-0.05, 0.05) == 4
    assert repeats_needed(0.0, 0.05) == pairs_needed(np.array(0.0), np.array(0.1)) == np.inf


def test_one_iteration_has_no_scatter():
    one = [dataclasses.replace(m, sums=m.sums[:, :, :1]) for m in (made_up(0), made_up(1))]
    assert np.isnan(stack(one).scatter).all()
    assert scores(one, measured_sums(), fitting=0.5)["iterations"] == 1


def test_picture_of_few_set_ups(tmp_path):
    plot_ensemble(stack([made_up(k) for k in range(3)]), measured_sums(), tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 20_000
