"""The ensemble's prior: what is drawn, and what is refused."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.method_settings import override
from stiction_envs.robots import load_arm
from stiction_envs.thesis import ensemble_prior
from stiction_envs.thesis.ensemble import (
    experiment_of,
)
from stiction_envs.thesis.ensemble_prior import (
    REASONS,
    draw,
    why_infeasible,
)
from stiction_envs.thesis.ensemble_settings import ensemble_settings

SETTINGS = ensemble_settings()


@pytest.fixture(scope="module")
def drawn():
    """Twelve set-ups."""
    return [draw(k).set_up for k in range(12)]


# ---- what is drawn -------------------------------------------------------------------------------


def test_draws_lie_within_their_ranges(drawn):
    s, rest = SETTINGS, load_arm("panda").rest
    for u in drawn:
        for k, of in enumerate(
            (s.start.joint_1, s.start.joint_2, s.start.joint_3, s.start.joint_4)
        ):
            assert of[0] <= u.start[k] - rest[k] <= of[1]
        for name in ("triangle_side", "triangle_slope", "pentagon_side"):
            low, high = getattr(s.paths, name)
            assert low <= getattr(u, name) <= high
        for name in ("speed", "acceleration", "position_tolerance", "patience"):
            low, high = getattr(s.motion, name)
            assert low <= getattr(u, name) <= high
        assert np.hypot(*u.tilt) <= s.offsets.tilt[1]
        assert u.tool in s.frame.tool
        assert u.hand in s.offsets.hand
    # ranges are used, not only kept: twelve draws come near both ends
    sides = np.array([u.pentagon_side for u in drawn])
    assert sides.max() > 1.6 * sides.min()
    assert {u.damping_design for u in drawn} == {"diagonal", "mass"}
    assert {u.triangle_goes for u in drawn} == {"down", "up"}


def test_hands_point_down_as_far_as_they_lean(drawn):
    for u in drawn:
        bench = experiment_of(dataclasses.replace(u, angles="hand", tilt=(0.0, 0.0)))
        w, x, y, z = bench.rig(1, 4).start_quaternion
        along = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        lean = np.arccos(np.clip(-along[2], -1, 1))
        assert lean <= SETTINGS.start.lean[1] + 1e-6


def test_a_draw_depends_on_its_number_and_seed_alone(drawn):
    assert draw(7).set_up == drawn[7]
    assert draw(7, seed=1).set_up != drawn[7]
    assert len({u.seed for u in drawn}) == len(drawn)


def test_sessions_scatter_as_the_prior_says(monkeypatch):
    s = SETTINGS
    monkeypatch.setattr(ensemble_prior, "why_infeasible", lambda *_: "")
    level = np.log([draw(k).set_up.no_dither for k in range(300)])
    wanted = np.hypot(np.repeat([s.friction.proximal, s.friction.wrist], [4, 3]), s.friction.common)
    np.testing.assert_allclose(level.std(axis=0), wanted, rtol=0.15)
    assert abs(level.mean()) < 0.01


def test_paths_are_turned_and_mirrored_not_bent(drawn):
    for u in drawn:
        for path, side in zip(u.paths().values(), (u.triangle_side, u.pentagon_side), strict=True):
            corners = np.concatenate([np.zeros((1, 3)), path.position])
            np.testing.assert_allclose(np.linalg.norm(np.diff(corners, axis=0), axis=1), side)
            np.testing.assert_allclose(path.position[-1], 0.0, atol=1e-12)
    left = dataclasses.replace(drawn[0], pentagon_turn="left", pentagon_azimuth=0.3).paths()
    right = dataclasses.replace(drawn[0], pentagon_turn="right", pentagon_azimuth=0.3).paths()

    def area(path):
        x, y, _ = path.position.T
        return 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)

    assert area(left["pentagon"]) == pytest.approx(-area(right["pentagon"]))
    up = dataclasses.replace(drawn[0], triangle_goes="up").paths()["triangle"]
    assert up.position[:, 2].max() > 0.01


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"motion.speed": [0.5, 0.1]}, "the least first"),
        ({"frame.angles": ["elbow"]}, "expected one of hand, flange"),
        ({"run.set_ups": 1}, "expected 2 or more"),
        ({"paths.pentagon_side": [-0.1, 0.2]}, "above 0"),
    ],
)
def test_a_wrong_prior_is_named(changes, message):
    with pytest.raises(StictionError, match=message):
        override(SETTINGS, changes)


# ---- what is refused -----------------------------------------------------------------------------


def test_drawn_set_ups_are_feasible_and_made_ones_are_not(drawn):
    u = drawn[0]
    assert why_infeasible(u) == ""
    high = load_arm("panda").limits.position[:, 1]
    near_limit = (*u.start[:6], high[6] - 0.1)
    assert why_infeasible(dataclasses.replace(u, start=near_limit)) == "limits"
    straight = (0.0, 0.3, 0.0, -0.3, 0.0, 0.6, 0.785)
    assert why_infeasible(dataclasses.replace(u, start=straight)) == "dexterity"
    low = (0.0, 0.6, 0.0, -2.2, 0.0, 2.8, 0.785)
    assert why_infeasible(dataclasses.replace(u, start=low, triangle_goes="down")) == "height"
    assert why_infeasible(dataclasses.replace(u, pentagon_side=0.7)) == "path"


def test_a_prior_out_of_reach_says_so():
    far = override(SETTINGS, {"paths.pentagon_side": [0.9, 1.0], "feasible.attempts": 3})
    with pytest.raises(StictionError, match="none of 3 drawn is feasible"):
        draw(0, settings=far)


def test_refused_draws_are_counted():
    found = [draw(k).refused for k in range(12)]
    assert set(found[0]) == set(REASONS)
    assert 0 < sum(sum(f.values()) for f in found) < 40
