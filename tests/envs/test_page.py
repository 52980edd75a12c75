"""An environment's page, its class docstring, says what the code does."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.envs import gte_core, gte_layout
from stiction_envs.envs.gte import GTEEnv
from stiction_envs.envs.layout import (
    action_table,
    observation_bounds,
    observation_names,
    observation_table,
)
from stiction_envs.envs.settings import gte_settings, sje_settings
from stiction_envs.envs.sje import SJEEnv
from stiction_envs.envs.sje_core import BLOCK_S, TERMS, SJECore
from stiction_envs.envs.sje_layout import GROUPS
from stiction_envs.experiments.gte.random_paths import random_path_settings
from stiction_envs.experiments.sje.protocol import load_protocol

PAGE = inspect.getdoc(SJEEnv) or ""


@pytest.mark.parametrize("table", [action_table(7), observation_table(7, GROUPS)])
def test_tables_are_the_generated_ones(table):
    assert table in PAGE


def test_every_reward_term_and_argument_is_explained():
    for term in TERMS:
        assert f"* `{term}`" in PAGE
    core = inspect.signature(SJECore.__init__).parameters
    for name in set(core) - {"self", "num_envs", "record"}:
        assert f"`{name}`" in PAGE
    assert f"a multiple of {BLOCK_S:g} s" in PAGE


def test_the_weight_of_shaking_on_the_page_is_the_one_in_use():
    weight, threshold = sje_settings().reward.shaking_weight, load_protocol("panda").threshold
    whole = 1e3 * threshold / np.sqrt(weight)
    words = " ".join(PAGE.split())
    assert f"Default {weight:.0f}: {whole:.2f} mrad all along would cost the whole torque" in words
    for name in ("power_weight", "torque_rate_weight"):
        assert f"{getattr(sje_settings().reward, name):g} each" in words, name
    assert f"above {sje_settings().reward.shaking_corner:g} Hz" in words


@pytest.mark.parametrize("n", [2, 7, 9])
def test_names_and_bounds_belong_together(n):
    low, high = observation_bounds(n, GROUPS)
    names = observation_names(n, GROUPS)
    assert len(names) == len(set(names)) == len(low) == 6 * n + 5
    assert np.all(low < high)
    assert np.all(np.isfinite([low, high]))


GTE_PAGE = inspect.getdoc(GTEEnv) or ""


@pytest.mark.parametrize("table", [action_table(7), observation_table(7, gte_layout.GROUPS)])
def test_gte_tables_are_the_generated_ones(table):
    assert table in GTE_PAGE


def test_every_gte_reward_term_info_and_argument_is_explained():
    core = gte_core.GTECore
    for term in gte_core.TERMS:
        assert f"* `{term}`" in GTE_PAGE
    for name in (*core.each, *core.final):
        assert f"`{name}`" in GTE_PAGE
    for name in set(inspect.signature(core.__init__).parameters) - {"self", "num_envs", "record"}:
        assert f"`{name}`" in GTE_PAGE
    for name in gte_layout.OPTIONS:
        assert f'"{name}": ' in GTE_PAGE


def test_gte_numbers_on_the_page_are_those_in_use():
    words, limits = " ".join(GTE_PAGE.split()), MotionLimits()
    assert f"is {limits.position_tolerance:g} m and {limits.rotation_tolerance:g} rad" in words
    assert f"v_max is {limits.translational_speed:g} m/s" in words
    assert f"ω_max {limits.rotational_speed:g} rad/s" in words
    drawn = [str(tuple(int(k) for k in row)) for row in gte_settings().episode.stiffness]
    assert f"from {' and '.join(drawn)}" in words
    assert f"(vibration / {1e3 * gte_settings().reward.shaking_unit:g} mm)" in words
    experiment = gte_core.GeneratedTrajectoryExperiment("iiwa7")
    block = gte_core.GTECore.block_steps(experiment)
    assert f"a multiple of {1e-3 * block:g} s" in words
    assert f"Default {gte_settings().random.paths}, whose undithered runs" in words
    assert f"({gte_settings().random.undithered_iterations} iterations each)" in words
    weights, s = gte_settings().reward, random_path_settings()
    assert f"Default {weights.settling_weight:g}: friction decides" in words
    for name in ("power_weight", "torque_rate_weight", "shaking_weight"):
        assert f"Default {getattr(weights, name):g} each" in words, name
    assert (s.fewest_goals, s.most_goals) == (3, 6)
    assert f"{2 * s.smallest:g} to {2 * s.largest:g} m long" in words
    assert f"up to {round(np.degrees(s.steepest))}°, at {s.slowest:g} to 1 of the speed" in words
    least = s.stiffness_translation, s.stiffness_rotation
    most = tuple(s.stiffness_range * k for k in least)
    low, high = (f"({k[0]:g}, {k[1]:g}, 0)" for k in (least, most))
    assert f"stiffness from {low} to {high}" in words
    assert f"mean over the {experiment.protocol.iterations}" in words.replace("means", "mean")


@pytest.mark.parametrize("n", [2, 7, 9])
def test_gte_names_and_bounds_belong_together(n):
    low, high = observation_bounds(n, gte_layout.GROUPS)
    names = observation_names(n, gte_layout.GROUPS)
    assert len(names) == len(set(names)) == len(low) == 5 * n + 20
    assert np.all(low < high)
    assert np.all(np.isfinite([low, high]))
