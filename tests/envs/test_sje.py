from __future__ import annotations

import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RescaleAction

from stiction_envs.envs.sje import SJEEnv
from stiction_envs.errors import StictionError
from stiction_envs.friction.parameters import load_friction
from tests.envs.helpers import IIWA, PANDA, QUICK, episode, make, mild, quiet

TWO_JOINTS = """
<mujoco model="two">
  <compiler angle="radian"/>
  <worldbody>
    <body name="base"><geom type="cylinder" size="0.05 0.05"/>
      <body name="a" pos="0 0 0.1">
        <joint name="a" axis="0 0 1" range="-2 2"/>
        <geom type="capsule" size="0.03" fromto="0 0 0.08 0.3 0 0.08" mass="1.5"/>
        <body name="b" pos="0.4 0 0.08">
          <joint name="b" axis="0 1 0" range="-2 2"/>
          <geom type="capsule" size="0.03" fromto="0.06 0 0 0.3 0 0" mass="1"/>
          <site name="tip" pos="0.3 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def panda():
    env = make()
    yield env
    env.close()


def test_import_is_light():
    code = (
        "import sys, stiction_envs, gymnasium as gym;"
        "assert 'PandaSJE-v0' in gym.registry and 'IiwaSJE-v0' in gym.registry;"
        "print([m for m in ('mujoco', 'torch', 'pinocchio', 'matplotlib') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


@pytest.mark.parametrize("name", [PANDA, IIWA])
def test_gymnasium_check(name):
    env = gym.make(name, fixed_options=QUICK)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env.unwrapped, skip_render_check=True)
    # amplitudes in N·m and frequencies in Hz cannot be in [-1, 1]: RescaleAction is for that
    assert all("symmetric and normalized" in str(w.message) for w in caught)


def test_stable_baselines_check():
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(RescaleAction(make(fixed_options=QUICK), -1, 1))


def test_seeds_draw_every_option(panda):
    infos = [panda.reset(seed=s)[1] for s in range(40)]
    assert {i["joint"] for i in infos} == set(range(1, 8))
    assert {i["load"] for i in infos} == {"load", "no_load"}
    assert {i["direction"] for i in infos} == {"+", "-"}


def test_options_do_not_shift_the_random_stream(panda):
    panda.reset(seed=3)
    free = panda.reset()[1]
    panda.reset(seed=3, options=QUICK)
    assert panda.reset()[1] == free


@pytest.mark.parametrize("name", [PANDA, IIWA])
@pytest.mark.parametrize("direction", ["+", "-"])
def test_rewards_sum_to_the_reduction_less_the_penalties(name, direction):
    """Σ reward = 1 − |τ_SJE|/|τ_base| + Σ penalties; the iiwa's ramp does not start at zero."""
    env = make(name)
    options = {"joint": 7, "load": "load", "direction": direction}
    steps = episode(env, mild(env, 7), seed=2, options=options)
    final = steps[-1][4]
    assert steps[-1][2]
    terms = [s[4]["reward_terms"] for s in steps[1:]]
    for s, t in zip(steps[1:], terms, strict=True):
        assert s[1] == pytest.approx(sum(t.values()), abs=1e-15)
    penalties = sum(t["power"] + t["torque_rate"] + t["shaking"] for t in terms)
    assert penalties < 0
    assert sum(t["shaking"] for t in terms) < -1e-4
    assert final["reduction"] == 1 - abs(final["tau_sje"]) / abs(final["tau_base"])
    assert sum(s[1] for s in steps) == pytest.approx(final["reduction"] + penalties, abs=1e-10)
    assert np.sign(final["tau_sje"]) == np.sign(final["tau_base"]) == float(f"{direction}1")
    if name == IIWA:
        assert all(t["torque_rate"] == 0 for t in terms)


def test_no_dither_and_no_scatter_is_the_base():
    """A joint that runs away by itself is hardly taken for shaken."""
    env = make(scatter=False)
    steps = episode(env, quiet(env), seed=0, options=QUICK)
    final = steps[-1][4]
    assert final["tau_sje"] == final["tau_base"]
    shaking = sum(s[4]["reward_terms"]["shaking"] for s in steps[1:])
    assert -0.02 < shaking < 0
    assert sum(s[1] for s in steps) - shaking == pytest.approx(0.0, abs=1e-12)


def test_weights_can_be_zero():
    env = make(power_weight=0.0, torque_rate_weight=0.0, shaking_weight=0.0)
    steps = episode(env, mild(env, 6), seed=1, options=QUICK)
    assert sum(s[1] for s in steps) == pytest.approx(steps[-1][4]["reduction"], abs=1e-12)


def test_amplitude_zero_is_no_dither_at_any_frequency(panda):
    def wobble(k: int) -> np.ndarray:
        action = quiet(panda)
        action[7:] = 5 + 7 * (k % 13)
        return action

    still = episode(panda, quiet(panda), seed=4, options=QUICK)
    wobbling = episode(panda, wobble, seed=4, options=QUICK)
    names = panda.unwrapped.observation_names
    physical = [k for k, n in enumerate(names) if not n.startswith("frequency")]
    for a, b in zip(still, wobbling, strict=True):
        assert np.array_equal(a[0][physical], b[0][physical])
        assert a[1:4] == b[1:4]


def test_dither_of_another_joint_acts(panda):
    still = episode(panda, quiet(panda), seed=4, options=QUICK)
    shaken = episode(panda, mild(panda, 4, share=1.0, frequency=20), seed=4, options=QUICK)
    assert shaken[-1][4]["tau_sje"] != still[-1][4]["tau_sje"]


def test_more_amplitude_shakes_more_and_another_joint_counts(panda):
    shaking = [
        episode(panda, mild(panda, j, share=s, frequency=12), seed=4, options=QUICK)[-1][4][
            "shaking"
        ]
        for j, s in ((6, 0.0), (6, 0.2), (6, 0.4), (4, 0.4))
    ]
    still, little, much, other = shaking
    assert 2 * still < little < 0.7 * much
    assert other > 2 * still


def test_observed_torques_are_the_ramp_and_what_holds_the_others(panda):
    """The servos stay within the stiction while the arm rests; dither is not among them."""
    names, core = panda.unwrapped.observation_names, panda.unwrapped.core
    panda.reset(seed=1, options=QUICK)
    for _ in range(4):
        observation, *_, info = panda.step(mild(panda, 6, share=0.2))
    see = dict(zip(names, observation, strict=True))
    assert see["torque_6"] * core.stiction[5] == pytest.approx(info["torque"], rel=1e-5)
    assert see["ramp"] * abs(core.tau_base[0]) == pytest.approx(info["torque"], rel=1e-5)
    others = [see[f"torque_{j}"] for j in (1, 2, 3, 4, 5, 7)]
    assert 0.01 < np.max(np.abs(others)) < 1.2


def test_rescaled_actions():
    env = make()
    scaled = RescaleAction(make(), -1, 1)
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


@pytest.mark.parametrize(
    ("options", "words"),
    [
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
)
def test_wrong_options(panda, options, words):
    with pytest.raises(StictionError) as error:
        panda.unwrapped.reset(seed=0, options=options)
    message = str(error.value)
    assert "\n" not in message
    assert all(w in message for w in words)


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
def test_wrong_actions(panda, change, words):
    panda.reset(seed=0, options=QUICK)
    action = quiet(panda)
    action[change[0]] = change[1]
    with pytest.raises(StictionError) as error:
        panda.unwrapped.step(action)
    message = str(error.value)
    assert "\n" not in message
    assert all(w in message for w in words)


@pytest.mark.parametrize("action", [np.zeros(13), np.zeros((2, 14)), "dither", None])
def test_actions_of_another_shape(panda, action):
    panda.reset(seed=0, options=QUICK)
    with pytest.raises(StictionError, match="action"):
        panda.unwrapped.step(action)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
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
    ],
)
def test_wrong_arguments(arguments, word):
    with pytest.raises(StictionError, match=word):
        SJEEnv(**arguments)


def test_step_needs_a_running_episode():
    env = make().unwrapped
    with pytest.raises(StictionError, match="reset"):
        env.step(quiet(env))


def test_truncation_gives_no_bonus():
    env = SJEEnv(control_interval_s=0.2, max_episode_steps=4)
    steps = episode(env, quiet(env), seed=0, options=QUICK)
    assert len(steps) == 5
    assert steps[-1][3]
    assert not steps[-1][2]
    final = steps[-1][4]
    assert np.isnan(final["tau_sje"])
    assert np.isnan(final["reduction"])
    assert final["reward_terms"]["breakaway"] == 0
    assert sum(s[1] for s in steps) == pytest.approx(-0.8 * 0.07 / abs(final["tau_base"]), rel=0.01)


def test_own_friction_and_payload_change_the_base():
    usual = make().unwrapped
    p = load_friction("panda")
    harder = make(friction=p.replace(stiction=1.2 * p.stiction, load_coefficient=np.zeros(7)))
    assert harder.action_space.high[5] != usual.action_space.high[5]
    loaded = make(payload=(1.0, 0.0, 0.0, 0.05))
    base = []
    for env in (usual, harder, loaded):
        env.reset(seed=0, options={**QUICK, "load": "load"})
        base.append(float(env.unwrapped.core.tau_base[0]))
    assert len(set(base)) == 3


def test_own_arm_with_two_joints(tmp_path):
    path = tmp_path / "two.xml"
    path.write_text(TWO_JOINTS)
    env = make(robot=str(path))
    assert env.action_space.shape == (4,)
    assert env.observation_space.shape == (17,)
    options = {"joint": 2, "load": "no_load", "direction": "-"}
    final = episode(env, mild(env, 2), seed=0, options=options)[-1][4]
    assert np.isfinite(final["reduction"])
