"""The ensemble of Table 4.11: what a set-up runs, and all of them."""

import dataclasses
import json

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import window_sums
from stiction_envs.friction.sticking import friction_of
from stiction_envs.method_settings import override
from stiction_envs.robots import load_arm
from stiction_envs.thesis import ensemble
from stiction_envs.thesis.ensemble import (
    DITHER,
    FREE,
    NO_DITHER,
    NO_DITHER_LATER,
    Member,
    experiment_of,
    run_ensemble,
    run_set_up,
    session_friction,
    shipped_lag,
    without_friction,
)
from stiction_envs.thesis.ensemble_prior import (
    draw,
)
from stiction_envs.thesis.ensemble_settings import ensemble_settings
from stiction_envs.thesis.gte import thesis_cases
from tests.experiments.gte.made_up import made_up as made_up_run
from tests.thesis.made_up_ensemble import SET_UP, made_up

SETTINGS = ensemble_settings()
SHIPPED = {
    "start": {f"joint_{j}": [0.0, 0.0] for j in range(1, 5)}
    | {"lean": [0.0, 0.0], "yaw": [0.0, 0.0]},
    "paths": {
        "triangle_side": [0.2, 0.2],
        "triangle_slope": [np.pi / 6, np.pi / 6],
        "triangle_goes": ["down"],
        "pentagon_side": [0.15, 0.15],
        "azimuth": [0.0, 0.0],
        "turn": ["left"],
    },
    "motion": {
        "speed": [0.5, 0.5],
        "acceleration": [0.2, 0.2],
        "position_tolerance": [0.04, 0.04],
        "rotation_tolerance": [0.25, 0.25],
        "patience": [1.0, 1.0],
    },
    "frame": {"tool": [0.0], "angles": ["hand"], "damping_design": ["diagonal"]},
    "offsets": {
        "offset": [1.0, 1.0],
        "gravity": [1.0, 1.0],
        "tilt": [0.0, 0.0],
        "hand": ["none"],
    },
    "friction": {"proximal": 0.0, "wrist": 0.0, "common": 0.0, "viscous": [1.0, 1.0]},
    "run": {"set_ups": 2, "iterations": 1},
}
"""A prior that holds nothing but the shipped set-up."""


@pytest.fixture(scope="module")
def drawn():
    """A set-up."""
    return [draw(k).set_up for k in range(1)]


# ---- what is run ---------------------------------------------------------------------------------


def test_a_prior_of_the_shipped_set_up_gives_the_shipped_experiment():
    s = override(SETTINGS, SHIPPED)
    u = draw(0, settings=s).set_up
    own, shipped = experiment_of(u, s, scatter=False), GeneratedTrajectoryExperiment("panda")
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
    s = override(SETTINGS, SHIPPED)
    found = run_set_up(0, settings=s, scatter=False)
    shipped = GeneratedTrajectoryExperiment("panda", scatter=False)
    sums = np.array([window_sums(r)[0] for r in shipped.run(thesis_cases(), iterations=1)])
    np.testing.assert_allclose(found.sums[NO_DITHER, :, 0], sums[::2], rtol=1e-5)
    np.testing.assert_allclose(found.sums[DITHER, :, 0], sums[1::2], rtol=1e-5)
    # one friction: the sessions are one
    np.testing.assert_array_equal(found.sums[NO_DITHER_LATER], found.sums[NO_DITHER])
    # friction is a part of the error, not all of it
    assert 0.3 < np.median(found.sums[FREE] / found.sums[NO_DITHER]) < 0.9


def test_hand_and_tilt_are_in_the_arm_and_known_as_drawn(drawn):
    u = dataclasses.replace(drawn[0], tilt=(0.0, 0.0))
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


def test_friction_of_sessions_and_of_none(drawn):
    u, p = drawn[0], friction_of(load_arm("panda"))
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
        assert case.stiffness[2] == (SETTINGS.run.posture if condition == FREE else 0.0)
        session = m.set_up.dither if condition in (DITHER, NO_DITHER_LATER) else m.set_up.no_dither
        share = SETTINGS.run.free if condition == FREE else 1.0
        np.testing.assert_allclose(p.stiction[:, 0], share * np.array(session) * own)
    assert m.sums.shape == (4, 4, SETTINGS.run.iterations, 6)
    level = 200 * own[0]
    np.testing.assert_allclose(m.sums[NO_DITHER], level * m.set_up.no_dither[0])
    np.testing.assert_allclose(m.sums[NO_DITHER_LATER], level * m.set_up.dither[0])
    np.testing.assert_allclose(m.sums[FREE], 0.01 * level * m.set_up.no_dither[0])
    assert Member.from_json(json.loads(json.dumps(m.to_json()))).set_up == m.set_up


def test_lag_of_the_shipped_set_up_is_what_no_friction_leaves(asked):
    found = shipped_lag(override(SETTINGS, {"run.free": 0.3}))
    assert found == {"diagonal": pytest.approx(0.3), "mass": pytest.approx(0.3)}
    assert len(asked) == 16
    assert not any(case.dither for case, _ in asked)


@pytest.fixture
def pretended(monkeypatch):
    """Set-ups that cost nothing; return the numbers of those that were run."""
    ran = []

    def run(number, **how):
        ran.append(number)
        return made_up(number, **how)

    monkeypatch.setattr(ensemble, "run_set_up", run)
    return ran


def test_an_interrupted_ensemble_goes_on(pretended, monkeypatch, tmp_path):
    s = override(SETTINGS, {"run.set_ups": 6})
    whole = tmp_path / "whole.jsonl"
    run_ensemble(whole, settings=s, nthread=2)
    pretended.clear()

    def stop(done, count):
        if done == 3:
            raise KeyboardInterrupt

    path, told = tmp_path / "ensemble.jsonl", []
    with pytest.raises(KeyboardInterrupt):
        run_ensemble(path, settings=s, nthread=1, progress=stop)
    kept = len(path.read_text().splitlines()) - 1
    assert 3 <= kept < 6
    pretended.clear()
    again = run_ensemble(path, settings=s, nthread=1, progress=lambda *x: told.append(x))
    assert len(pretended) == 6 - kept
    assert told == [(k, 6) for k in range(kept, 7)]
    assert path.read_bytes() == whole.read_bytes()
    for k, member in enumerate(again):
        assert member.number == k
        assert member.set_up == SET_UP
        np.testing.assert_array_equal(member.sums, made_up(k).sums)


def test_an_ensemble_of_other_settings_is_not_continued(pretended, tmp_path):
    s = override(SETTINGS, {"run.set_ups": 2})
    run_ensemble(tmp_path / "a.jsonl", settings=s)
    for how in ({"seed": 1}, {"scatter": False}):
        with pytest.raises(StictionError, match="other settings"):
            run_ensemble(tmp_path / "a.jsonl", settings=s, **how)
    with pytest.raises(StictionError, match="other settings"):
        run_ensemble(tmp_path / "a.jsonl", settings=override(s, {"friction.common": 0.1}))


@pytest.mark.slow
def test_same_bits_on_any_number_of_threads(tmp_path):
    quick = {"run.set_ups": 2, "run.iterations": 1, "motion.acceleration": [0.4, 0.4]}
    s = override(SETTINGS, quick)
    one = run_ensemble(tmp_path / "one.jsonl", settings=s, nthread=1)
    run_ensemble(tmp_path / "two.jsonl", settings=s, nthread=2)
    assert (tmp_path / "one.jsonl").read_bytes() == (tmp_path / "two.jsonl").read_bytes()
    assert not np.array_equal(one[0].sums, one[1].sums)
