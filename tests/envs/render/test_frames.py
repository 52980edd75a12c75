import numpy as np
import pytest
from gymnasium.wrappers import RenderCollection

from stiction_envs.envs.render import window
from stiction_envs.envs.render.frames import SIZE
from stiction_envs.envs.sje import SJEEnv
from stiction_envs.errors import StictionError
from tests.command_line import python
from tests.envs.helpers import (
    IIWA_GTE,
    PANDA,
    QUICK,
    TRIANGLE,
    TURRET,
    divided,
    make,
    make_gte,
    mild,
)
from tests.envs.render.conftest import blue, orange


def cut(mark: np.ndarray) -> bool:
    """Whether the edge of the frame cuts a mark."""
    return np.concatenate([mark[0], mark[-1], mark[:, 0], mark[:, -1]]).any()


@pytest.mark.usefixtures("gl")
def test_sje_frames_show_the_arm_and_how_far_its_joint_has_moved():
    """The pointer turns with the joint under test."""
    env = make(render_mode="rgb_array")
    assert env.metadata["render_fps"] == 5
    env.reset(seed=0, options=QUICK)
    first, done = env.render(), False
    assert first.std() > 10
    while not done:
        *_, terminated, truncated, _ = env.step(mild(env, 6))
        done = terminated or truncated
    last = env.render()
    assert orange(last).sum() > 100
    assert (orange(last) != orange(first)).sum() > 30, "the pointer has turned"
    env.close()
    env.close()


@pytest.mark.usefixtures("gl")
def test_gymnasium_s_wrappers_record_the_frames(kind):
    """`RecordVideo` takes the frames as `RenderCollection` does, and an encoder."""
    env = RenderCollection(kind.make(render_mode="rgb_array"))
    env.reset(seed=0, options=kind.options)
    for _ in range(2):
        env.step(mild(env, 6))
    frames = env.render()
    assert [(f.shape, f.dtype) for f in frames] == 3 * [((SIZE, SIZE, 3), np.uint8)]
    env.close()


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("joint", [1, 4, 7])
def test_the_marker_is_seen_on_every_joint_and_inside_the_frame(joint):
    env = make(render_mode="rgb_array")
    for load in ("load", "no_load"):
        env.reset(seed=0, options={"joint": joint, "load": load})
        mark = orange(env.render())
        assert mark.sum() > 60
        assert not cut(mark)
    env.close()


@pytest.mark.usefixtures("gl")
def test_a_batch_gives_one_frame_each(kind, monkeypatch):
    """In two batches: the last frame is that of the single environment with its seed."""
    other = {"sje": {"joint": 4}, "gte": {"trajectory": "pentagon"}}[kind.name]
    options = [kind.options, kind.options, {**kind.options, **other}]
    env = divided(monkeypatch, kind, 2, 3, render_mode="rgb_array")
    env.reset(seed=0, options=options)
    frames = env.render()
    assert len(frames) == 3
    single = kind.make(render_mode="rgb_array")
    single.reset(seed=2, options=options[2])
    assert np.array_equal(frames[2], single.render())
    assert not np.array_equal(frames[0], frames[2])
    env.close()
    single.close()


@pytest.mark.usefixtures("gl")
def test_an_own_arm_is_drawn(kind, two):
    two.write_text(TURRET)
    env = kind.make(robot=two, render_mode="rgb_array")
    env.reset(seed=0, options={} if kind.name == "sje" else TRIANGLE)
    scene = env.render()
    assert orange(scene).sum() > 60 if kind.name == "sje" else blue(scene).sum() > 100
    env.close()


@pytest.mark.usefixtures("gl")
def test_gte_frames_show_the_path_and_its_goal_and_the_camera_rests():
    env = make_gte(IIWA_GTE, render_mode="rgb_array")
    assert env.metadata["render_fps"] == 5
    env.reset(seed=0, options={**TRIANGLE, "trajectory": "pentagon"})
    first, reached = env.render(), 0
    assert blue(first).sum() > 150
    assert orange(first).sum() > 20, "the goal"
    assert not cut(blue(first))
    assert not cut(orange(first))
    while reached < 2:
        reached = env.step(mild(env, 6))[4]["goals_reached"]
    frame = env.render()
    assert (orange(frame) & ~orange(first)).sum() > 20, "another goal is the next"
    assert np.array_equal(frame[:60, :60], first[:60, :60]), "the camera rests"
    env.close()


def test_rendering_does_not_touch_the_physics(kind):
    results = []
    for mode in (None, "rgb_array"):
        env = kind.make(render_mode=mode, disable_env_checker=True)
        env.reset(seed=1, options=kind.options)
        results.append([env.step(mild(env, 6))[0] for _ in range(3)])
    assert np.array_equal(*results)


def test_without_display_a_window_is_one_clear_line(monkeypatch):
    monkeypatch.setattr(window, "has_display", lambda: False)
    env = SJEEnv(render_mode="human")
    with pytest.raises(StictionError, match="no display found"):
        env.reset(seed=0, options=QUICK)


def test_without_opengl_only_rendering_fails():
    code = (
        "import gymnasium as gym\n"
        "from stiction_envs.errors import StictionError\n"
        f"env = gym.make({PANDA!r}, render_mode='rgb_array', disable_env_checker=True)\n"
        f"env.reset(seed=0, options={QUICK!r})\n"
        "env.step(env.action_space.low)\n"
        "try:\n    env.render()\n"
        "except StictionError as error:\n    print(error)\n"
        "env.step(env.action_space.low); env.close()\n"
    )
    run = python(code, MUJOCO_GL="glfw", DISPLAY="", WAYLAND_DISPLAY="")
    assert run.returncode == 0, run.stderr
    assert len(run.stdout.strip().splitlines()) == 1
    assert "rendering needs OpenGL" in run.stdout
    assert "Traceback" not in run.stderr
