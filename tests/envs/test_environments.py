"""Tests of both environments, alone and in Gymnasium's wrappers."""

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RescaleAction

from tests.envs.helpers import TRIANGLE, TURRET, Kind, episode, mild, quiet, same
from tests.refusal import refusal


def of_each(**cases: list[tuple]) -> pytest.MarkDecorator:
    """Parametrise a test with cases of each experiment, by its name."""
    rows = [(name, *case) for name, found in cases.items() for case in found]
    return pytest.mark.parametrize(("kind", "wrong", "words"), rows, indirect=["kind"])


def test_gymnasium_check(kind):
    env = kind.make(kind.iiwa, fixed_options=kind.options)
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


def test_own_arm_with_two_joints(kind, two):
    two.write_text(TURRET)
    seen, options, last = {
        "sje": (17, {"joint": 2, "load": "no_load", "direction": "-"}, "reduction"),
        "gte": (30, TRIANGLE, "error"),
    }[kind.name]
    env = kind.make(robot=two)
    assert env.action_space.shape == (4,)
    assert env.observation_space.shape == (seen,)
    final = episode(env, mild(env, 2), seed=0, options=options)[-1][4]
    assert np.isfinite(final[last]).all()
    assert final.get("goals_reached", 3) == 3


# ---- what is refused -----------------------------------------------------------------------------


@of_each(
    sje=[
        ({"axis": 1}, ("axis", "joint, load, direction")),
        ({"joint": 8}, ("joint", "1, 2, 3, 4, 5, 6, 7")),
        ({"joint": True}, ("joint", "True")),
        ({"load": None}, ("load", "load, no_load")),
        ({"direction": "up"}, ("direction", "+, -")),
        (["joint"], ("list", "dict")),
    ],
    gte=[
        ({"joint": 1}, ("joint", "trajectory, path, stiffness, iteration")),
        ({"path": -1}, ("path is -1", "`int` >= 0")),
        ({"trajectory": "pentagon", "path": 1}, ("path 1", "pentagon", "expected 'random'")),
        ({"trajectory": "square"}, ("square", "triangle, pentagon, random")),
        ({"stiffness": (200, np.nan, 0)}, ("stiffness", "nan")),
        ({"stiffness": ("a", 1, 2)}, ("stiffness", "expected `float`")),
        ({"iteration": 1.0}, ("iteration", "1.0")),
    ],
)
def test_wrong_options(env, wrong, words):
    line = refusal(lambda: env.unwrapped.reset(seed=0, options=wrong))
    assert [w for w in words if w not in line] == []


def test_wrong_actions(kind, env):
    env.reset(seed=0, options=kind.options)
    bad, slow = quiet(env), quiet(env)
    bad[2], slow[7] = np.nan, 4.0
    for action, words in (
        (bad, "amplitude of joint 3.*nan"),
        (slow, "frequency of joint 1.*expected 5 to 100 Hz"),
        (np.zeros(13), "action"),
        ("dither", "action"),
    ):
        refusal(lambda action=action: env.unwrapped.step(action), words)


@of_each(
    sje=[
        ({"control_interval_s": 0.03}, "multiples"),
        ({"torque_rate_weight": float("nan")}, "torque_rate_weight"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"fixed_options": {"joint": 9}}, "joint"),
        ({"robot": "fanuc"}, "fanuc"),
        ({"friction": "nowhere.toml"}, "nowhere.toml"),
        ({"render_mode": "ascii"}, "rgb_array"),
        ({"threads": -1}, "threads is -1: expected `int` >= 0"),
    ],
    gte=[
        ({"control_interval_s": 0.05}, "multiples of 0.02 s"),
        ({"settling_weight": 1.5}, "settling_weight is 1.5: expected `float` <= 1"),
        ({"random_paths": 0}, "random_paths is 0: expected `int` >= 1"),
        ({"start": [0.0] * 6}, "expected 7 angles"),
        ({"start": "rest"}, "expected 7 angles"),
        ({"tool": (0.0, 0.1)}, "three finite numbers"),
        ({"compensation": "pull"}, "feedforward, push"),
    ],
)
def test_wrong_arguments(kind: Kind, wrong, words):
    refusal(lambda: kind.single(**wrong), words)


def test_an_unknown_argument_names_the_nearest(kind):
    for make in (kind.make, lambda **given: kind.make_vec(2, **given)):
        says = "unexpected keyword argument 'nthread'.*nearest is 'threads'"
        refusal(lambda make=make: make(nthread=1), says)
    # what TorchRL waits for: it tries an argument, and takes it back
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        kind.make(frameskip=1)


def test_step_needs_a_running_episode(kind):
    env = kind.make().unwrapped
    refusal(lambda: env.step(quiet(env)), "reset")
