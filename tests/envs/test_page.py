"""The environment's page, its class docstring, says what the code does."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from stiction_envs.envs.core import BLOCK_S, TERMS
from stiction_envs.envs.layout import (
    action_table,
    observation_bounds,
    observation_names,
    observation_table,
)
from stiction_envs.envs.sje import SJEEnv

PAGE = inspect.getdoc(SJEEnv) or ""


@pytest.mark.parametrize("table", [action_table(7), observation_table(7)])
def test_tables_are_the_generated_ones(table):
    assert table in PAGE


def test_every_reward_term_and_argument_is_explained():
    for term in TERMS:
        assert f"* `{term}`" in PAGE
    core = inspect.signature(SJEEnv.__init__.__globals__["Core"].__init__).parameters
    for name in set(core) - {"self", "num_envs", "record"}:
        assert f"`{name}`" in PAGE
    assert f"a multiple of {BLOCK_S:g} s" in PAGE


@pytest.mark.parametrize("n", [2, 7, 9])
def test_names_and_bounds_belong_together(n):
    low, high = observation_bounds(n)
    names = observation_names(n)
    assert len(names) == len(set(names)) == len(low) == 5 * n + 5
    assert np.all(low < high)
    assert np.all(np.isfinite([low, high]))
