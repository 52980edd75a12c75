"""The environments within the wrappers that people put around them: Gymnasium's and SB3's.

`render/test_frames.py` has the real mp4 of ``RecordVideo``.
"""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.wrappers import (
    NormalizeObservation,
    RecordEpisodeStatistics,
    RecordVideo,
    TimeLimit,
)

from tests.envs.helpers import (
    PANDA,
    PANDA_GTE,
    QUICK,
    TRIANGLE,
    episode,
    make,
    make_gte,
    mild,
    quiet,
    same,
)

KINDS = {"sje": (make, QUICK), "gte": (make_gte, TRIANGLE)}


@pytest.fixture(params=KINDS)
def kind(request):
    """How to make an environment, and the options of an episode."""
    return KINDS[request.param]


def test_record_episode_statistics_sums_what_was_rewarded(kind):
    make_one, options = kind
    env = RecordEpisodeStatistics(make_one())
    steps = episode(env, mild(env, 6), seed=0, options=options)
    found = steps[-1][4]["episode"]
    assert found["r"] == pytest.approx(sum(s[1] for s in steps))
    assert found["l"] == len(steps) - 1
    assert all("episode" not in s[4] for s in steps[:-1])


def test_time_limit_truncates_and_ends_nothing(kind):
    make_one, options = kind
    env = TimeLimit(make_one(), max_episode_steps=3)
    free = make_one()
    cut, whole = (episode(e, quiet(e), seed=0, options=options) for e in (env, free))
    assert len(cut) == 4 < len(whole)
    assert cut[-1][2:4] == (False, True)
    for a, b in zip(cut[:3], whole[:3], strict=True):
        assert same(a, b)
    assert len(episode(env, quiet(env), seed=1, options=options)) == 4, "a reset starts it anew"


def test_normalize_observation_has_zero_mean_and_leaves_the_physics(kind):
    make_one, options = kind
    env, plain = NormalizeObservation(make_one()), make_one()
    seen = []
    for seed in range(3):
        normal = episode(env, mild(env, 6), seed=seed, options=options)
        bare = episode(plain, mild(plain, 6), seed=seed, options=options)
        assert [s[1:4] for s in normal] == [s[1:4] for s in bare]
        seen += [s[0] for s in normal]
        assert all(s[0].dtype == np.float32 for s in normal)
    late = np.array(seen[len(seen) // 2 :])
    assert np.isfinite(late).all()
    assert np.abs(late.mean(axis=0)).max() < 3.0
    assert env.obs_rms.mean.shape == plain.observation_space.shape


def test_record_video_takes_a_frame_a_step(kind, monkeypatch, tmp_path):
    """Frames are small arrays here: drawing and writing are tested where they are done."""
    pytest.importorskip("moviepy")
    make_one, options = kind
    inner = make_one(render_mode="rgb_array")
    monkeypatch.setattr(type(inner.unwrapped), "render", lambda self: np.zeros((4, 4, 3), np.uint8))
    env = RecordVideo(inner, str(tmp_path), episode_trigger=lambda k: True)
    kept = []
    monkeypatch.setattr(env, "stop_recording", lambda: kept.append(len(env.recorded_frames)))
    steps = episode(env, mild(env, 6), seed=0, options=options)
    assert len(env.recorded_frames) == len(steps)
    assert env.frames_per_sec == inner.metadata["render_fps"]
    plain = make_one()
    bare = episode(plain, mild(plain, 6), seed=0, options=options)
    assert [s[1:4] for s in steps] == [s[1:4] for s in bare]


@pytest.mark.parametrize(("name", "options"), [(PANDA, QUICK), (PANDA_GTE, TRIANGLE)])
def test_stable_baselines_normalises(name, options, tmp_path):
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    from stiction_envs.envs.sb3 import make_sb3
    from tests.envs.helpers import sprint

    more = {"motion": sprint()} if name == PANDA_GTE else {}
    given = {"control_interval_s": 0.2, "fixed_options": options, **more}
    short = name.split(":")[1]

    def venv():
        return make_sb3(short, 2, **given)

    env = vec_env.VecNormalize(venv(), gamma=0.99)
    env.seed(0)
    first = env.reset()
    assert np.isfinite(first).all()
    ended = 0
    for _ in range(60):
        observation, reward, done, infos = env.step(np.full((2, 14), -1.0, dtype=np.float32))
        assert observation.dtype == np.float32
        assert np.abs(observation).max() <= env.clip_obs
        assert np.abs(reward).max() <= env.clip_reward
        ended += int(done.sum())
        for over, info in zip(done, infos, strict=True):
            assert over == ("terminal_observation" in info)
    assert ended >= 2
    env.save(str(tmp_path / "normal.pkl"))
    again = vec_env.VecNormalize.load(str(tmp_path / "normal.pkl"), venv())
    assert np.array_equal(again.obs_rms.mean, env.obs_rms.mean)
    raw = env.get_original_obs()
    assert np.array_equal(again.normalize_obs(raw), env.normalize_obs(raw))
