"""Samplers by name: which one runs, also without PyTorch."""

from __future__ import annotations

import pytest

from stiction_envs.errors import StictionError
from tests.tuning.study.searches import SPACE
from tuning.search.search import search as search_dither
from tuning.study import samplers


def test_an_unknown_sampler_is_one_clear_line():
    with pytest.raises(StictionError, match="unknown sampler 'annealing': expected one of gp"):
        samplers.sampler("annealing", SPACE, seed=0)


def test_a_study_keeps_the_sampler_that_ran(small_arm, fast, tmp_path, monkeypatch):
    """If PyTorch is installed in mid-study, gp must not continue what tpe began."""
    missing = ["torch"]
    monkeypatch.setattr(samplers, "find_spec", lambda name: None if name in missing else name)
    small = {"search.draws": 1, "search.verify_draws": 1, "search.verify_iterations": 1}

    def found(evaluations):
        options = {"protocol": fast, "settings": small, "evaluations": evaluations}
        storage = f"sqlite:///{tmp_path / 'study.db'}"
        return search_dither(small_arm, out=tmp_path / str(evaluations), storage=storage, **options)

    with pytest.warns(UserWarning, match="sampler gp needs PyTorch: tpe is used"):
        found(1)
    missing.clear()
    with pytest.raises(StictionError, match="is of sampler tpe: expected gp, or another --study"):
        found(2)
    assert not (tmp_path / "2").exists()
