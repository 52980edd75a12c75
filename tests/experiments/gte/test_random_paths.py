"""Numbered random paths: the same for an arm whoever asks, and such that it can follow."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.control.trajectory import Path
from stiction_envs.experiments.gte import random_paths as module
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.gte.random_paths import (
    can_follow,
    random_path_settings,
    random_paths,
)
from stiction_envs.precomputed import store

STRAIGHT = np.array([[1.0, 0.0, 0.0, 0.0]])


@pytest.fixture
def nothing_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STICTION_CACHE", "off")
    monkeypatch.setattr(store, "_memory", {})


@pytest.mark.parametrize("robot", ["panda", "iiwa7"])
def test_a_number_is_the_same_path_whoever_asks(robot, nothing_known):
    e = GeneratedTrajectoryExperiment(robot)
    arm = e.sticking, e.start, e.tool
    many = random_paths(*arm, range(40, 56))
    assert list(many) == list(range(40, 56))
    store.forget()
    for k in (41, 55):
        alone = random_paths(*arm, [k])[k]  # searched for, then known
        again = random_paths(*arm, [k])[k]
        for one in (alone, again):
            assert np.array_equal(one.path.position, many[k].path.position)
            assert (one.path.pace, one.stiffness) == (many[k].path.pace, many[k].stiffness)


def test_paths_are_as_the_settings_say():
    s = random_path_settings()
    drawn = [module._draw(k, np.random.default_rng(k), s) for k in range(300)]
    counts = {len(d.path.position) for d in drawn}
    assert counts == set(range(s.fewest_goals, s.most_goals + 1))
    farthest = max(np.linalg.norm(d.path.position, axis=1).max() for d in drawn)
    assert s.largest < farthest < 1.5 * s.largest
    pace = np.array([d.path.pace for d in drawn])
    stiffness = np.array([d.stiffness for d in drawn])
    assert s.slowest < pace.min() < 0.65 < 0.95 < pace.max() < 1
    assert 100 < stiffness[:, 0].min() < 110
    assert 730 < stiffness[:, 0].max() < 800
    assert np.median(stiffness[:, 0]) == pytest.approx(100 * np.sqrt(8), rel=0.15), "log-uniform"
    np.testing.assert_allclose(stiffness[:, 0], 10 * stiffness[:, 1])


@pytest.mark.parametrize("robot", ["panda", "iiwa7", "iiwa14"])
def test_the_houses_own_paths_can_be_followed_and_others_not(robot):
    e, usual = GeneratedTrajectoryExperiment(robot), random_path_settings()
    arm, low = (e.sticking, e.start, e.tool), e.sticking.arm.limits.position[:, 0]
    own = [e.path("triangle"), e.path("pentagon")]
    far = Path("far", np.array([[1.5, 0.0, 0.0]]), STRAIGHT)
    into_the_base = Path("base", np.array([[-0.6, 0.0, 0.0]]), STRAIGHT)
    followed = can_follow(*arm, [*own, far, into_the_base], usual)
    assert followed.tolist() == [True, True, False, False]
    stricter = dataclasses.replace(usual, least_dexterity=1.0)
    assert not can_follow(*arm, own, stricter).any(), "no pose of theirs is as good as the start"
    edge = e.start.copy()
    edge[0] = low[0] + 0.1
    assert not can_follow(e.sticking, edge, e.tool, own, usual).any(), "joint 1 is at its limit"


def test_a_slow_path_takes_an_arm_longer():
    e = GeneratedTrajectoryExperiment("panda")
    path = e.path("random-2")
    fast = dataclasses.replace(path, pace=1.0)
    assert e.nominal_duration(fast) == pytest.approx(path.pace * e.nominal_duration(path))
    both = GeneratedTrajectoryExperiment("panda", paths={"fast": fast})
    names = ("fast", "random-2")
    cases = [Case(trajectory=n, stiffness=(400, 40, 0)) for n in names]
    first, second = (run.reached[0, -1] for run in both.run(cases, iterations=1))
    assert second - first > 0.5 * (e.nominal_duration(path) - e.nominal_duration(fast))
