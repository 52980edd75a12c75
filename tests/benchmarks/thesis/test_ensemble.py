"""The ensemble of Table 4.11: what is drawn and refused, what a set-up runs, what is made of it."""

import csv
import dataclasses

import numpy as np
import pytest

from benchmarks.thesis.ensemble import runs, set_ups
from benchmarks.thesis.ensemble.page import write_ensemble
from benchmarks.thesis.ensemble.runs import (
    DITHER,
    FREE,
    NO_DITHER,
    NO_DITHER_LATER,
    experiment_of,
    measured_sums,
    run_ensemble,
    run_set_up,
    session_friction,
    shipped_lag,
    thesis_cases,
    without_friction,
)
from benchmarks.thesis.ensemble.scores import (
    coverage,
    factor,
    friction_gone,
    inside,
    intervals,
    lag,
    pairs_needed,
    signs_right,
    stack,
)
from benchmarks.thesis.ensemble.set_ups import REASONS, draw, prior, why_infeasible
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import window_sums
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.friction.sticking import friction_of
from stiction_envs.measured import thesis_table
from stiction_envs.robots import load_arm
from tests.benchmarks.thesis import made_up
from tests.benchmarks.thesis.made_up import SET_UP
from tests.experiments.gte.made_up import made_up as made_up_run

PRIOR = prior()
SHIPPED = {
    **{f"start.joint_{j}": [0.0, 0.0] for j in range(1, 5)},
    **{"start.lean": [0.0, 0.0], "start.yaw": [0.0, 0.0]},
    **{"paths.triangle_side": [0.2, 0.2], "paths.triangle_slope": [np.pi / 6, np.pi / 6]},
    **{"paths.triangle_goes": ["down"], "paths.pentagon_side": [0.15, 0.15]},
    **{"paths.azimuth": [0.0, 0.0], "paths.turn": ["left"]},
    **{"motion.speed": [0.5, 0.5], "motion.acceleration": [0.2, 0.2]},
    **{"motion.position_tolerance": [0.04, 0.04], "motion.rotation_tolerance": [0.25, 0.25]},
    **{"motion.patience": [1.0, 1.0], "frame.tool": [0.0], "frame.angles": ["hand"]},
    **{"frame.damping_design": ["diagonal"], "offsets.offset": [1.0, 1.0]},
    **{"offsets.gravity": [1.0, 1.0], "offsets.tilt": [0.0, 0.0], "offsets.hand": ["none"]},
    **{"friction.proximal": 0.0, "friction.wrist": 0.0, "friction.common": 0.0},
    **{"friction.viscous": [1.0, 1.0], "run.set_ups": 2, "run.iterations": 1},
}
"""A prior that holds nothing but the shipped set-up."""


@pytest.fixture(scope="module")
def drawn():
    """Twelve draws."""
    return [draw(k) for k in range(12)]


# ---- what is drawn -------------------------------------------------------------------------------


def test_draws_lie_within_their_ranges(drawn):
    rest = load_arm("panda").rest
    for u in (d.set_up for d in drawn):
        for k in range(4):
            low, high = PRIOR["start"][f"joint_{k + 1}"]
            assert low <= u.start[k] - rest[k] <= high
        for table, names in {
            "paths": ("triangle_side", "triangle_slope", "pentagon_side"),
            "motion": ("speed", "acceleration", "position_tolerance", "patience"),
        }.items():
            for name in names:
                low, high = PRIOR[table][name]
                assert low <= getattr(u, name) <= high
        assert np.hypot(*u.tilt) <= PRIOR["offsets"]["tilt"][1]
        assert u.tool in PRIOR["frame"]["tool"]
        assert u.hand in PRIOR["offsets"]["hand"]
    # ranges are used, not only kept: twelve draws come near both ends
    sides = np.array([d.set_up.pentagon_side for d in drawn])
    assert sides.max() > 1.6 * sides.min()
    assert {d.set_up.damping_design for d in drawn} == {"diagonal", "mass"}
    assert {d.set_up.triangle_goes for d in drawn} == {"down", "up"}


def test_hands_point_down_as_far_as_they_lean(drawn):
    for u in (d.set_up for d in drawn):
        bench = experiment_of(dataclasses.replace(u, angles="hand", tilt=(0.0, 0.0)))
        w, x, y, z = bench.rig(1, 4).start_quaternion
        along = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        lean = np.arccos(np.clip(-along[2], -1, 1))
        assert lean <= PRIOR["start"]["lean"][1] + 1e-6


def test_a_draw_depends_on_its_number_and_seed_alone(drawn):
    assert draw(7).set_up == drawn[7].set_up
    assert draw(7, seed=1).set_up != drawn[7].set_up
    assert len({d.set_up.seed for d in drawn}) == len(drawn)


def test_sessions_scatter_as_the_prior_says(monkeypatch):
    monkeypatch.setattr(set_ups, "why_infeasible", lambda *_: "")
    level = np.log([draw(k).set_up.no_dither for k in range(300)])
    friction = PRIOR["friction"]
    spread = np.repeat([friction["proximal"], friction["wrist"]], [4, 3])
    np.testing.assert_allclose(level.std(axis=0), np.hypot(spread, friction["common"]), rtol=0.15)
    assert abs(level.mean()) < 0.01


def test_paths_are_turned_and_mirrored_not_bent(drawn):
    for u in (d.set_up for d in drawn):
        for path, side in zip(u.paths().values(), (u.triangle_side, u.pentagon_side), strict=True):
            corners = np.concatenate([np.zeros((1, 3)), path.position])
            np.testing.assert_allclose(np.linalg.norm(np.diff(corners, axis=0), axis=1), side)
            np.testing.assert_allclose(path.position[-1], 0.0, atol=1e-12)

    def area(turn: str) -> float:
        u = dataclasses.replace(SET_UP, pentagon_turn=turn, pentagon_azimuth=0.3)
        x, y, _ = u.paths()["pentagon"].position.T
        return 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)

    assert area("left") == pytest.approx(-area("right"))
    up = dataclasses.replace(SET_UP, triangle_goes="up").paths()["triangle"]
    assert up.position[:, 2].max() > 0.01


def test_drawn_set_ups_are_feasible_and_made_ones_are_not(drawn):
    u = drawn[0].set_up
    assert why_infeasible(u) == ""
    high = load_arm("panda").limits.position[:, 1]
    near_limit = (*u.start[:6], high[6] - 0.1)
    assert why_infeasible(dataclasses.replace(u, start=near_limit)) == "limits"
    straight = (0.0, 0.3, 0.0, -0.3, 0.0, 0.6, 0.785)
    assert why_infeasible(dataclasses.replace(u, start=straight)) == "dexterity"
    low = (0.0, 0.6, 0.0, -2.2, 0.0, 2.8, 0.785)
    assert why_infeasible(dataclasses.replace(u, start=low, triangle_goes="down")) == "height"
    assert why_infeasible(dataclasses.replace(u, pentagon_side=0.7)) == "path"
    far = prior({"paths.pentagon_side": [0.9, 1.0], "feasible.attempts": 3})
    with pytest.raises(StictionError, match="none of 3 drawn is feasible"):
        draw(0, ranges=far)


def test_refused_draws_are_counted(drawn):
    assert set(drawn[0].refused) == set(REASONS)
    assert 0 < sum(sum(d.refused.values()) for d in drawn) < 40


# ---- what is run ---------------------------------------------------------------------------------


def test_cases_are_those_of_table_4_11():
    cases = thesis_cases()
    assert [c.dithered for c in cases] == [False, True] * 4
    assert all(c.dither == thesis_final_dither() for c in cases[1::2])
    assert 6 * len({(c.trajectory, c.stiffness) for c in cases}) == len(thesis_table("4.11"))


def test_a_prior_of_the_shipped_set_up_gives_the_shipped_experiment():
    of = prior(SHIPPED)
    u = draw(0, ranges=of).set_up
    own, shipped = experiment_of(u, of, scatter=False), GeneratedTrajectoryExperiment("panda")
    np.testing.assert_allclose(own.start, shipped.start, atol=1e-9)
    for limit in dataclasses.fields(shipped.motion):
        got, wanted = (getattr(e.motion, limit.name) for e in (own, shipped))
        assert got == pytest.approx(wanted), limit.name
    assert own.settings.damping_design == shipped.settings.damping_design
    assert own.controller_model is None
    assert own.seed == u.seed
    for name in ("triangle", "pentagon"):
        np.testing.assert_allclose(own.path(name).position, shipped.path(name).position, atol=1e-12)
    p = friction_of(load_arm("panda"))
    for field in ("stiction", "load_coefficient", "viscous", "offset", "gravity_error"):
        np.testing.assert_array_equal(getattr(own.sticking.parameters, field), getattr(p, field))


@pytest.mark.slow
def test_the_shipped_set_up_gives_the_shipped_sums():
    found = run_set_up(0, ranges=prior(SHIPPED), scatter=False)
    shipped = GeneratedTrajectoryExperiment("panda", scatter=False)
    sums = np.array([window_sums(r)[0] for r in shipped.run(thesis_cases(), iterations=1)])
    np.testing.assert_allclose(found.sums[NO_DITHER, :, 0], sums[::2], rtol=1e-5)
    np.testing.assert_allclose(found.sums[DITHER, :, 0], sums[1::2], rtol=1e-5)
    # one friction: the sessions are one
    np.testing.assert_array_equal(found.sums[NO_DITHER_LATER], found.sums[NO_DITHER])
    # friction is a part of the error, not all of it
    assert 0.3 < np.median(found.sums[FREE] / found.sums[NO_DITHER]) < 0.9


def test_hand_and_tilt_are_in_the_arm_and_known_as_drawn():
    u = dataclasses.replace(SET_UP, tilt=(0.0, 0.0))
    benches = {
        h: experiment_of(dataclasses.replace(u, hand=h)) for h in ("none", "known", "unknown")
    }
    assert benches["none"].controller_model is benches["known"].controller_model is None
    assert benches["none"].sticking.arm.payload is None
    assert benches["unknown"].sticking.arm.payload[0] == 0.73
    assert benches["unknown"].controller_model.payload is None
    tilted = experiment_of(dataclasses.replace(u, hand="known", tilt=(0.02, 0.0)))
    assert tilted.controller_model.tilt == (0.0, 0.0)
    assert tilted.controller_model.payload[0] == 0.73
    flange = experiment_of(dataclasses.replace(u, angles="flange"))
    assert flange.sticking.arm.hand_yaw == 0.0


def test_friction_of_sessions_and_of_none():
    u, p = SET_UP, friction_of(load_arm("panda"))
    q = session_friction(u, u.dither)
    np.testing.assert_allclose(q.stiction / p.stiction, np.array(u.dither)[:, None] * [[1, 1]])
    np.testing.assert_allclose(q.offset, u.offset * p.offset)
    free = without_friction(q, 0.01)
    np.testing.assert_allclose(free.stiction, 0.01 * q.stiction)
    np.testing.assert_array_equal(free.viscous, q.viscous)


@pytest.fixture
def asked(monkeypatch):
    """Pretend to run cases: errors are the stiction of joint 1; return what was asked for."""
    seen = []

    def run(self, cases, *, parameters, iterations, progress=None):
        seen.extend(zip(cases, parameters, strict=True))
        error = np.zeros((iterations, 700, 6))
        return [
            dataclasses.replace(
                made_up_run(error + p.stiction[0, 0], iterations=iterations), case=case
            )
            for case, p in zip(cases, parameters, strict=True)
        ]

    monkeypatch.setattr(GeneratedTrajectoryExperiment, "run", run)
    return seen


def test_a_set_up_runs_its_sessions_and_its_lag(asked):
    m = run_set_up(0)
    own = friction_of(load_arm("panda")).stiction[:, 0]
    assert len(asked) == 16
    for k, (case, p) in enumerate(asked):
        condition, place = divmod(k, 4)
        printed = thesis_cases()[2 * place + (condition == DITHER)]
        assert (case.trajectory, case.dither) == (printed.trajectory, printed.dither)
        assert case.stiffness[:2] == printed.stiffness[:2]
        # without friction the elbow would fall
        assert case.stiffness[2] == (PRIOR["run"]["posture"] if condition == FREE else 0.0)
        session = m.set_up.dither if condition in (DITHER, NO_DITHER_LATER) else m.set_up.no_dither
        share = PRIOR["run"]["free"] if condition == FREE else 1.0
        np.testing.assert_allclose(p.stiction[:, 0], share * np.array(session) * own)
    assert m.sums.shape == (4, 4, PRIOR["run"]["iterations"], 6)
    level = 200 * own[0]
    np.testing.assert_allclose(m.sums[NO_DITHER], level * m.set_up.no_dither[0])
    np.testing.assert_allclose(m.sums[NO_DITHER_LATER], level * m.set_up.dither[0])
    np.testing.assert_allclose(m.sums[FREE], 0.01 * level * m.set_up.no_dither[0])


def test_lag_of_the_shipped_set_up_is_what_no_friction_leaves(asked):
    found = shipped_lag(prior({"run.free": 0.3}))
    assert found == {"diagonal": pytest.approx(0.3), "mass": pytest.approx(0.3)}
    assert len(asked) == 16
    assert not any(case.dither for case, _ in asked)


@pytest.fixture
def pretended(monkeypatch):
    """Set-ups that cost nothing; return the numbers of those that were run."""
    ran = []

    def run(number, **how):
        ran.append(number)
        return made_up.run_set_up(number, **how)

    monkeypatch.setattr(runs, "run_set_up", run)
    return ran


def test_an_interrupted_ensemble_goes_on(pretended, tmp_path):
    six, path, told = prior({"run.set_ups": 6}), tmp_path / "ensemble.jsonl", []

    def stop(done, count):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_ensemble(path, ranges=six, threads=1, progress=stop)
    kept = len(path.read_text().splitlines())
    assert 3 <= kept < 6
    pretended.clear()
    again = run_ensemble(path, ranges=six, threads=1, progress=lambda *x: told.append(x))
    assert len(pretended) == 6 - kept
    assert told == [(k, 6) for k in range(kept, 7)]
    for k, member in enumerate(again):
        assert member.number == k
        assert member.set_up == SET_UP
        np.testing.assert_array_equal(member.sums, made_up.run_set_up(k).sums)


def test_set_ups_of_another_prior_or_seed_are_not_taken(pretended, tmp_path):
    two = prior({"run.set_ups": 2})
    for how in ({}, {"seed": 1}, {"scatter": False}, {"ranges": prior({"run.set_ups": 3})}):
        pretended.clear()
        members = run_ensemble(tmp_path / "a.jsonl", **{"ranges": two, **how})
        assert sorted(pretended) == [m.number for m in members]


@pytest.mark.slow
def test_same_bits_on_any_number_of_threads(tmp_path):
    quick = {"run.set_ups": 2, "run.iterations": 1, "motion.acceleration": [0.4, 0.4]}
    one, two = (
        run_ensemble(tmp_path / f"{n}.jsonl", ranges=prior(quick), threads=n) for n in (1, 2)
    )
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.sums, b.sums)
    assert not np.array_equal(one[0].sums, one[1].sums)


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
    drawn = [inside(ends, rng.normal(size=24)).sum(axis=1) for _ in range(200)]
    half, most = np.mean(drawn, axis=0)
    assert half == pytest.approx(12.0, abs=1.0)
    assert most == pytest.approx(21.6, abs=0.6)
    # a set-up of the ensemble held against the others: what 24 coins give
    own = coverage(values, np.zeros(24)).own_90
    assert (own[0], own[2]) == (pytest.approx(19, abs=1), pytest.approx(24, abs=0.1))


def test_a_table_from_elsewhere_is_seldom_covered():
    values = np.random.default_rng(2).normal(size=(100, 24))
    far = coverage(values, np.full(24, 4.0))
    assert (far.in_50, far.in_90, far.as_few) == (0, 0, 0)
    assert far.own_90[0] > far.in_90
    assert coverage(values, values[0]).as_few > 5
    # cells that hang together are inside or outside together
    together = coverage(values[:, :1] + np.zeros(24), np.zeros(24))
    assert together.in_50 == 24
    assert (together.own_90[0], together.own_90[2]) == (0, 24)


def test_scores_of_known_numbers():
    before, after = measured_sums()
    change = np.log(after / before)
    assert signs_right(np.full((1, 24), -0.1), change)[0] == 19
    assert signs_right(change[None], change)[0] == 24
    assert factor(2.0 * before[None], before)[0] == pytest.approx(2.0)
    assert lag(0.4 * before[None], before[None])[0] == pytest.approx(0.4)
    # an effect as large as two standard errors of eight pairs
    assert pairs_needed(np.array(1.0), np.array(1.0)) == 8
    assert pairs_needed(np.array(-0.1), np.array(0.1)) == 8
    assert pairs_needed(np.array(0.05), np.array(0.1)) == 32
    assert pairs_needed(np.array(0.0), np.array(0.1)) == np.inf
    fall = np.full(24, np.log(0.9))
    np.testing.assert_allclose(friction_gone(fall, np.array([0.0, 0.5, 0.95])), [0.1, 0.2, 2.0])
    assert friction_gone(fall, np.array([1.1])) == np.inf


def test_stacked_sums_tell_dither_from_session():
    sums = stack([made_up.run_set_up(k) for k in range(8)])
    before, after = measured_sums()
    both, dither, session = sums.changes().values()
    assert sums.no_dither.shape == (8, 24)
    np.testing.assert_allclose(np.median(session), np.log(1.02), atol=0.02)
    np.testing.assert_allclose(both, dither + session)
    np.testing.assert_allclose(np.median(both, axis=0), np.log(after / before), atol=0.12)
    assert np.sqrt((sums.scatter**2).mean()) == pytest.approx(0.05, rel=0.2)


def test_files_follow_the_numbers(tmp_path):
    members = [made_up.run_set_up(k) for k in range(30)]
    shipped = {"diagonal": 0.51, "mass": 0.83}
    text = write_ensemble(tmp_path, members, shipped)
    assert {p.name for p in tmp_path.iterdir()} == {"ensemble.csv", "ensemble.png"}
    with open(tmp_path / "ensemble.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 30
    assert float(rows[3]["start_4"]) == SET_UP.start[3]
    assert rows[0]["hand"] == SET_UP.hand
    mean = members[3].sums[NO_DITHER, 2].mean(axis=0)
    assert float(rows[3]["no_dither_pentagon_200_roll"]) == mean[3]
    assert float(rows[3]["signs_right_two_sessions"]) <= 24
    assert "30 set-ups" in text
    assert '| "every error falls" | 19 |' in text
    assert "; 51 %" in text or "; 83 %" in text
    sums = stack(members)
    found = coverage(np.log(sums.no_dither), np.log(measured_sums()[0]))
    assert f"| sums without dither | {found.in_50} of 24 | {found.in_90} of 24 |" in text
    other = [dataclasses.replace(m, sums=9.0 * m.sums) for m in members]
    text = write_ensemble(tmp_path, other, shipped)
    assert "| sums without dither | 0 of 24 | 0 of 24 |" in text
    assert "| 0 of 30 |" in text
    # one iteration has no scatter
    one = [dataclasses.replace(m, sums=m.sums[:, :, :1]) for m in members]
    assert np.isnan(stack(one).scatter).all()
    assert "1 iterations each" in write_ensemble(tmp_path, one, shipped)
