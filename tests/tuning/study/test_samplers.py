"""Samplers by name: which one runs, also without PyTorch."""

from __future__ import annotations

import pytest

from stiction_envs.errors import StictionError
from tests.tuning.study.searches import SPACE
from tuning.study import samplers


def test_an_unknown_sampler_is_one_clear_line():
    with pytest.raises(StictionError, match="unknown sampler 'annealing': expected one of gp"):
        samplers.sampler("annealing", SPACE, seed=0)
