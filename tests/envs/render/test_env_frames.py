from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.envs.render import env_frames as render
from stiction_envs.envs.render import window
from stiction_envs.envs.sje import SJEEnv
from stiction_envs.errors import StictionError
from tests.command_line import python
from tests.envs.helpers import (
    IIWA_GTE,
    PANDA,
    QUICK,
    TRIANGLE,
    TWO_JOINTS,
    divided,
    make,
    make_gte,
    mild,
)
from tests.envs.render.conftest import blue, orange

HEIGHT, SCENE, WIDTH = render.HEIGHT, render.SCENE_WIDTH, render.SCENE_WIDTH + render.PANEL_WIDTH


@pytest.mark.usefixtures("gl")
def test_frames_show_arm_marker_and_plot():
    env = make(render_mode="rgb_array")
    assert env.metadata["render_fps"] == 5
    env.reset(seed=0, options=QUICK)
    first = env.render()
    for _ in range(5):
        env.step(mild(env, 6))
    frame = env.render()
    assert frame.shape == (HEIGHT, WIDTH, 3)
    assert frame.dtype == np.uint8
    assert frame[:, :SCENE].std() > 10
    assert orange(frame[:, :SCENE]).sum() > 100
    panel, before = frame[:, SCENE:], first[:, SCENE:]
    assert (panel != before).any(axis=2).sum() > 300, "the plots have grown"
    blue = (panel[:, :, 2].astype(int) - panel[:, :, 0]) > 100
    assert blue.sum() > 20, "the commanded torque is drawn"
    env.close()
    env.close()


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("joint", [1, 4, 7])
def test_the_marker_is_seen_on_every_joint_and_inside_the_frame(joint):
    env = make(render_mode="rgb_array")
    for load in ("load", "no_load"):
        env.reset(seed=0, options={"joint": joint, "load": load})
        mark = orange(env.render()[:, :SCENE])
        assert mark.sum() > 60
        border = np.concatenate([mark[0], mark[-1], mark[:, 0], mark[:, -1]])
        assert not border.any()
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
def test_an_own_arm_is_drawn(kind, tmp_path):
    path = tmp_path / "two.xml"
    path.write_text(TWO_JOINTS)
    env = kind.make(robot=str(path), render_mode="rgb_array")
    env.reset(seed=0, options={} if kind.name == "sje" else TRIANGLE)
    scene = env.render()[:, :SCENE]
    assert orange(scene).sum() > 60 if kind.name == "sje" else blue(scene).sum() > 100
    env.close()


@pytest.mark.usefixtures("gl")
def test_gte_frames_show_the_path_its_goal_the_trail_and_the_plots():
    env = make_gte(IIWA_GTE, render_mode="rgb_array")
    assert env.metadata["render_fps"] == 5
    env.reset(seed=0, options={**TRIANGLE, "trajectory": "pentagon"})
    first = env.render()
    assert blue(first[:, :SCENE]).sum() > 150
    assert orange(first[:, :SCENE]).sum() > 20, "the goal"
    for mark in (blue(first[:, :SCENE]), orange(first[:, :SCENE])):
        assert not np.concatenate([mark[0], mark[-1], mark[:, 0], mark[:, -1]]).any()
    for _ in range(6):
        env.step(mild(env, 6))
    frame = env.render()
    assert frame.shape == (HEIGHT, WIDTH, 3)
    assert frame.dtype == np.uint8
    assert orange(frame[:, :SCENE]).sum() > orange(first[:, :SCENE]).sum(), "the trail has grown"
    panel, before = frame[:, SCENE:], first[:, SCENE:]
    assert (panel != before).any(axis=2).sum() > 300, "the plots have grown"
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
