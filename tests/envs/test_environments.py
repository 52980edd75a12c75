"""What the environments of both experiments have in common, alone and in Gymnasium's wrappers.

`render/test_env_frames.py` has the real mp4 of ``RecordVideo``.
"""

from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import (
    NormalizeObservation,
    RecordEpisodeStatistics,
    RecordVideo,
    RescaleAction,
    TimeLimit,
)

from stiction_envs.errors import StictionError
from tests.envs.helpers import (
    GTE,
    QUICK,
    SJE,
    TRIANGLE,
    TWO_JOINTS,
    Kind,
    episode,
    mild,
    quiet,
    refused,
    same,
)


def of_each(**cases: list[tuple]) -> pytest.MarkDecorator:
    """Parametrise a test with cases of each experiment, by its name."""
    rows = [(name, *case) for name, found in cases.items() for case in found]
    return pytest.mark.parametrize(("kind", "wrong", "words"), rows, indirect=["kind"])


@pytest.mark.parametrize("arm", ["panda", "iiwa"])
def test_gymnasium_check(kind, arm):
    env = kind.make(getattr(kind, arm), fixed_options=kind.options)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env.unwrapped, skip_render_check=True)
    # amplitudes in N·m and frequencies in Hz cannot be in [-1, 1]: RescaleAction is for that
    assert all("symmetric and normalized" in str(w.message) for w in caught)


def test_stable_baselines_check(kind):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(RescaleAction(kind.make(fixed_options=kind.options), -1, 1))


def test_actions_have_the_same_bounds():
    assert GTE.make().action_space == SJE.make().action_space


def test_options_do_not_shift_the_random_stream(kind, env):
    env.reset(seed=3)
    free = env.reset()
    more = {"iteration": 4} if kind.name == "gte" else {}
    env.reset(seed=3, options={**kind.options, **more})
    assert same(env.reset(), free)


def test_amplitude_zero_is_no_dither_at_any_frequency(kind, env):
    def wobble(k: int) -> np.ndarray:
        action = quiet(env)
        action[7:] = 5 + 7 * (k % 13)
        return action

    still = episode(env, quiet(env), seed=4, options=kind.options)
    wobbling = episode(env, wobble, seed=4, options=kind.options)
    names = env.unwrapped.observation_names
    physical = [k for k, n in enumerate(names) if not n.startswith("frequency")]
    for a, b in zip(still, wobbling, strict=True):
        assert np.array_equal(a[0][physical], b[0][physical])
        assert a[1:4] == b[1:4]


def test_own_arm_with_two_joints(kind, tmp_path):
    path = tmp_path / "two.xml"
    path.write_text(TWO_JOINTS)
    seen, options, last = {
        "sje": (17, {"joint": 2, "load": "no_load", "direction": "-"}, "reduction"),
        "gte": (30, TRIANGLE, "error"),
    }[kind.name]
    env = kind.make(robot=str(path))
    assert env.action_space.shape == (4,)
    assert env.observation_space.shape == (seen,)
    final = episode(env, mild(env, 2), seed=0, options=options)[-1][4]
    assert np.isfinite(final[last]).all()
    assert final.get("goals_reached", 3) == 3


# ---- what is refused -----------------------------------------------------------------------------


@of_each(
    sje=[
        ({"axis": 1}, ("axis", "joint, load, direction")),
        ({"joint": 0}, ("joint", "1, 2, 3, 4, 5, 6, 7")),
        ({"joint": 8}, ("joint", "1, 2, 3, 4, 5, 6, 7")),
        ({"joint": "1"}, ("joint", "'1'")),
        ({"joint": 1.0}, ("joint", "1.0")),
        ({"joint": True}, ("joint", "True")),
        ({"load": "heavy"}, ("load", "load, no_load")),
        ({"load": None}, ("load", "load, no_load")),
        ({"direction": 1}, ("direction", "+, -")),
        ({"direction": "up"}, ("direction", "+, -")),
        (["joint"], ("list", "dict")),
    ],
    gte=[
        ({"joint": 1}, ("joint", "trajectory, path, stiffness, iteration")),
        ({"path": -1}, ("path -1", "whole number")),
        ({"path": "1"}, ("path '1'", "whole number")),
        ({"trajectory": "pentagon", "path": 1}, ("path 1", "pentagon", "expected 'random'")),
        ({"trajectory": "square"}, ("square", "triangle, pentagon, random")),
        ({"trajectory": 3}, ("3", "triangle, pentagon")),
        ({"stiffness": (200, 20)}, ("stiffness", "three")),
        ({"stiffness": (200, -20, 0)}, ("stiffness", "-20")),
        ({"stiffness": (200, np.nan, 0)}, ("stiffness", "nan")),
        ({"stiffness": 200}, ("stiffness", "three")),
        ({"stiffness": ("a", 1, 2)}, ("stiffness", "three")),
        ({"iteration": -1}, ("iteration", "-1")),
        ({"iteration": 1.0}, ("iteration", "1.0")),
        ({"iteration": True}, ("iteration", "True")),
        (["trajectory"], ("list", "dict")),
    ],
)
def test_wrong_options(env, wrong, words):
    with refused(*words):
        env.unwrapped.reset(seed=0, options=wrong)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((2, np.nan), ("amplitude of joint 3", "nan")),
        ((2, -0.1), ("amplitude of joint 3", "-0.1")),
        ((0, 1e6), ("amplitude of joint 1", "expected 0 to")),
        ((7, 4.0), ("frequency of joint 1", "expected 5 to 100 Hz")),
        ((13, np.inf), ("frequency of joint 7", "inf")),
    ],
)
def test_wrong_actions(kind, env, change, words):
    env.reset(seed=0, options=kind.options)
    action = quiet(env)
    action[change[0]] = change[1]
    with refused(*words):
        env.unwrapped.step(action)


@pytest.mark.parametrize("action", [np.zeros(13), np.zeros((2, 14)), "dither", None])
def test_actions_of_another_shape(kind, env, action):
    env.reset(seed=0, options=kind.options)
    with refused("action"):
        env.unwrapped.step(action)


@of_each(
    sje=[
        ({"control_interval_s": 0.03}, "multiples"),
        ({"control_interval_s": float("nan")}, "multiples"),
        ({"power_weight": -1}, "power_weight"),
        ({"torque_rate_weight": float("nan")}, "torque_rate_weight"),
        ({"shaking_weight": -1}, "shaking_weight"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"fixed_options": {"joint": 9}}, "joint"),
        ({"robot": "fanuc"}, "fanuc"),
        ({"friction": "nowhere.toml"}, "nowhere.toml"),
        ({"render_mode": "ascii"}, "rgb_array"),
        ({"threads": -1}, "-1 threads: expected whole numbers from 0"),
    ],
    gte=[
        ({"control_interval_s": 0.05}, "multiples of 0.02 s"),
        ({"shaking_weight": -1}, "shaking_weight"),
        ({"settling_weight": 1.5}, "settling_weight 1.5: expected 0 to 1"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"random_paths": 0}, "random_paths 0: expected a whole number from 1"),
        ({"fixed_options": {"trajectory": "line"}}, "line"),
        ({"robot": "fanuc"}, "fanuc"),
        ({"friction": "nowhere.toml"}, "nowhere.toml"),
        ({"start": [0.0] * 6}, "6 angles: expected 7"),
        ({"start": "rest"}, "expected 7 angles"),
        ({"tool": (0.0, 0.1)}, "three finite numbers"),
        ({"compensation": "pull"}, "feedforward, push"),
        ({"render_mode": "ascii"}, "rgb_array"),
        ({"threads": -1}, "-1 threads: expected whole numbers from 0"),
    ],
)
def test_wrong_arguments(kind: Kind, wrong, words):
    with pytest.raises(StictionError, match=words):
        kind.single(**wrong)


def test_an_unknown_argument_names_the_nearest(kind):
    for make in (kind.make, lambda **given: kind.make_vec(2, **given)):
        with refused("unknown argument 'nthread'", "nearest is 'threads'"):
            make(nthread=1)
    with refused("unknown argument 'record'"):
        kind.make(record=True)


def test_step_needs_a_running_episode(kind):
    env = kind.make().unwrapped
    with pytest.raises(StictionError, match="reset"):
        env.step(quiet(env))


# ---- in wrappers ---------------------------------------------------------------------------------


def test_record_episode_statistics_sums_what_was_rewarded(kind):
    env = RecordEpisodeStatistics(kind.make())
    steps = episode(env, mild(env, 6), seed=0, options=kind.options)
    found = steps[-1][4]["episode"]
    assert found["r"] == pytest.approx(sum(s[1] for s in steps))
    assert found["l"] == len(steps) - 1
    assert all("episode" not in s[4] for s in steps[:-1])


def test_time_limit_truncates_and_ends_nothing(kind):
    env = TimeLimit(kind.make(), max_episode_steps=3)
    cut, whole = (episode(e, quiet(e), seed=0, options=kind.options) for e in (env, kind.make()))
    assert len(cut) == 4 < len(whole)
    assert cut[-1][2:4] == (False, True)
    for a, b in zip(cut[:3], whole[:3], strict=True):
        assert same(a, b)
    again = episode(env, quiet(env), seed=1, options=kind.options)
    assert len(again) == 4, "a reset starts it anew"
    limited = gym.make(kind.panda, max_episode_steps=2)
    assert episode(limited, quiet(env), seed=0, options=kind.options)[-1][3]


def test_normalize_observation_has_zero_mean_and_leaves_the_physics(kind, env):
    normalised = NormalizeObservation(kind.make())
    seen = []
    for seed in range(3):
        normal, bare = (
            episode(e, mild(e, 6), seed=seed, options=kind.options) for e in (normalised, env)
        )
        assert [s[1:4] for s in normal] == [s[1:4] for s in bare]
        seen += [s[0] for s in normal]
        assert all(s[0].dtype == np.float32 for s in normal)
    late = np.array(seen[len(seen) // 2 :])
    assert np.isfinite(late).all()
    assert np.abs(late.mean(axis=0)).max() < 3.0
    assert normalised.obs_rms.mean.shape == env.observation_space.shape


def test_record_video_takes_a_frame_a_step(kind, env, monkeypatch, tmp_path):
    """Frames are small arrays here: drawing and writing are tested where they are done."""
    pytest.importorskip("moviepy")
    inner = kind.make(render_mode="rgb_array")
    monkeypatch.setattr(type(inner.unwrapped), "render", lambda self: np.zeros((4, 4, 3), np.uint8))
    film = RecordVideo(inner, str(tmp_path), episode_trigger=lambda k: True)
    monkeypatch.setattr(film, "stop_recording", lambda: None)
    steps = episode(film, mild(film, 6), seed=0, options=kind.options)
    assert len(film.recorded_frames) == len(steps)
    assert film.frames_per_sec == inner.metadata["render_fps"]
    bare = episode(env, mild(env, 6), seed=0, options=kind.options)
    assert [s[1:4] for s in steps] == [s[1:4] for s in bare]


@pytest.mark.parametrize("kind", ["sje"], indirect=True)
def test_rescaled_actions(kind, env):
    scaled = RescaleAction(kind.make(), -1, 1)
    action = mild(env, 6, share=0.5)
    low, high = env.action_space.low, env.action_space.high
    normalised = (2 * (action - low) / (high - low) - 1).astype(np.float32)
    a = episode(env, action, seed=1, options=QUICK)
    b = episode(scaled, normalised, seed=1, options=QUICK)
    assert b[-1][4]["tau_sje"] == pytest.approx(a[-1][4]["tau_sje"], rel=1e-3)
    scaled.reset(seed=1)
    for corner in (-1.0, 1.0):
        scaled.step(np.full(14, corner, dtype=np.float32))
    scaled.step(-np.ones(14, dtype=np.float32))
    assert not scaled.unwrapped.core.rig.dither.amplitude.any()
