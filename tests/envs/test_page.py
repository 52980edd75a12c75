"""An environment's page, its class docstring, says what the code does; its signature too."""

import inspect
from dataclasses import fields

import numpy as np
import pytest

from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.envs.gte import GTEEnv, GTEVectorEnv
from stiction_envs.envs.sje import SJEEnv, SJEVectorEnv
from stiction_envs.experiments.gte.episodes import OPTIONS
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.protocol import episode_settings, gte_reward_settings
from stiction_envs.experiments.gte.random_paths import random_path_settings
from stiction_envs.experiments.observation import observation_bounds, observation_names
from stiction_envs.experiments.sje.protocol import load_protocol, sje_reward_settings
from stiction_envs.plant import CONTROL_DT

ENVS = {SJEEnv: (SJEVectorEnv, 6, 5), GTEEnv: (GTEVectorEnv, 5, 20)}
"""Batch of each environment; elements of the observation per joint, and other elements."""


def words(env: type) -> str:
    return " ".join((inspect.getdoc(env) or "").split())


@pytest.mark.parametrize("env", ENVS)
def test_every_term_measure_and_argument_is_explained(env):
    page, e, one = inspect.getdoc(env) or "", env.episodes, np.zeros(1, dtype=int)
    core = e(1)
    core.reset(one, [np.random.default_rng(0)], [None])
    each, last = core.step(one, core.action_space.low[None]).measures, core.last_measures(one)
    for term in e.terms:
        assert f"* `{term}`" in page
    for name in (*each, *last, *(f.name for f in fields(e.arguments))):
        assert f"`{name}`" in page
    experiment = GeneratedTrajectoryExperiment("iiwa7")
    assert "| 0–6 | amplitude, joint 1 … 7 |" in page
    assert all(f"| {g.meaning} |" in page for g in e.groups)
    assert f"a multiple of {CONTROL_DT * e.block_steps(experiment):g} s" in page


@pytest.mark.parametrize("env", ENVS)
def test_the_signature_names_every_argument_with_its_default(env):
    vector, *_ = ENVS[env]
    given = {f.name: f.default for f in fields(env.episodes.arguments)}
    for cls, own in ((env, ("render_mode",)), (vector, ("num_envs", "autoreset_mode"))):
        found = inspect.signature(cls).parameters
        assert {k: found[k].default for k in given} == given
        assert set(own) < set(found)


@pytest.mark.parametrize("env", ENVS)
def test_names_and_bounds_belong_together(env):
    n, (*_, per_joint, others) = 9, ENVS[env]
    low, high = observation_bounds(n, env.episodes.groups)
    names = observation_names(n, env.episodes.groups)
    assert len(names) == len(set(names)) == len(low) == per_joint * n + others
    assert np.all(low < high)
    assert np.all(np.isfinite([low, high]))


def test_sje_numbers_on_the_page_are_those_in_use():
    weights, page = sje_reward_settings(), words(SJEEnv)
    whole = 1e3 * load_protocol("panda").threshold / np.sqrt(weights.shaking_weight)
    shown = f"Default {weights.shaking_weight:.0f}: {whole:.2f} mrad all along would cost the whole"
    assert f"{shown} torque" in page
    for name in ("power_weight", "torque_rate_weight"):
        assert f"{getattr(weights, name):g} each" in page, name
    assert f"above {weights.shaking_corner:g} Hz" in page


def test_gte_numbers_on_the_page_are_those_in_use():
    page, limits, episodes = words(GTEEnv), MotionLimits(), episode_settings()
    assert f"is {limits.position_tolerance:g} m and {limits.rotation_tolerance:g} rad" in page
    assert f"v_max is {limits.translational_speed:g} m/s" in page
    assert f"ω_max {limits.rotational_speed:g} rad/s" in page
    drawn = [str(tuple(int(k) for k in row)) for row in episodes.stiffness]
    assert f"from {' and '.join(drawn)}" in page
    assert f"(vibration / {1e3 * gte_reward_settings().shaking_unit:g} mm)" in page
    assert f"Default {episodes.random_paths}, whose undithered runs" in page
    assert f"({episodes.undithered_iterations} iterations each)" in page
    weights, s = gte_reward_settings(), random_path_settings()
    assert f"Default {weights.settling_weight:g}: friction decides" in page
    for name in ("power_weight", "torque_rate_weight", "shaking_weight"):
        assert f"Default {getattr(weights, name):g} each" in page, name
    assert (s.fewest_goals, s.most_goals) == (3, 6)
    assert f"{2 * s.smallest:g} to {2 * s.largest:g} m long" in page
    assert f"up to {round(np.degrees(s.steepest))}°, at {s.slowest:g} to 1 of the speed" in page
    least = s.stiffness_translation, s.stiffness_rotation
    most = tuple(s.stiffness_range * k for k in least)
    low, high = (f"({k[0]:g}, {k[1]:g}, 0)" for k in (least, most))
    assert f"stiffness from {low} to {high}" in page
    iterations = GeneratedTrajectoryExperiment("iiwa7").protocol.iterations
    assert f"mean over the {iterations}" in page.replace("means", "mean")
    for name in OPTIONS:
        assert f'"{name}": ' in (inspect.getdoc(GTEEnv) or "")
