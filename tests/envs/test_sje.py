"""The SJE environment: reward and observation; see `test_environments`."""

import numpy as np
import pytest

from stiction_envs.envs.sje import SJEEnv
from tests.envs.helpers import IIWA, PANDA, QUICK, episode, make, mild, quiet


@pytest.fixture(scope="module")
def panda():
    return make()


def test_seeds_draw_every_option(panda):
    infos = [panda.reset(seed=s)[1] for s in range(40)]
    assert {i["joint"] for i in infos} == set(range(1, 8))
    assert {i["load"] for i in infos} == {"load", "no_load"}
    assert {i["direction"] for i in infos} == {"+", "-"}


@pytest.mark.parametrize(("name", "direction"), [(PANDA, "-"), (IIWA, "+")])
def test_rewards_sum_to_the_reduction_less_the_penalties(name, direction):
    """Σ reward = 1 − |τ_SJE|/|τ_base| + Σ penalties; the iiwa's ramp does not start at zero."""
    env = make(name)
    options = {"joint": 7, "load": "load", "direction": direction}
    steps = episode(env, mild(env, 7), seed=2, options=options)
    final = steps[-1][4]
    assert steps[-1][2]
    terms = [s[4]["reward_terms"] for s in steps[1:]]
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
