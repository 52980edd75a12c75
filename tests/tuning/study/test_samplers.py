"""Samplers by name: which one runs, also without PyTorch or from another package."""

from __future__ import annotations

from importlib.metadata import EntryPoint

import optuna
import pytest

from stiction_envs.cli import main
from stiction_envs.errors import StictionError
from tests.tuning.study.searches import SPACE, evaluate, search
from tuning.search.options import Options
from tuning.search.search import search as search_dither
from tuning.study import samplers
from tuning.study.record import run


def made_elsewhere(space, seed):
    """Be the sampler of another package."""
    assert set(space) >= {"frequency_hz"}
    return optuna.samplers.QMCSampler(seed=seed, warn_independent_sampling=False)


@pytest.fixture
def outside(monkeypatch):
    """Another package is installed, which brings the sampler ``halton``."""
    point = EntryPoint("halton", f"{__name__}:made_elsewhere", samplers.GROUP)

    def found(group, name="halton"):
        return (point,) if (group, name) == (samplers.GROUP, "halton") else ()

    monkeypatch.setattr(samplers, "entry_points", found)
    monkeypatch.setattr("tuning.commands.tune.entry_points", found)


@pytest.mark.filterwarnings("ignore::optuna.exceptions.ExperimentalWarning")
def test_a_sampler_from_another_package_works_wherever_one_is_named(
    outside, small_arm, fast, tmp_path, capsys
):
    found = search("sqlite://", "halton", evaluations=5)
    run([found], evaluate)
    assert len({tuple(t.params.values()) for t in found.record.trials}) == 5
    assert samplers.sampler("halton", SPACE, seed=0)(3) is not None
    assert Options(sampler="halton", pareto="power").sampler_of("sje") == "halton"
    assert main(["tune", "--help"]) == 0
    assert "halton" in capsys.readouterr().out
    small = {"search.draws": 1, "search.verify_draws": 1, "search.verify_iterations": 1}
    found = search_dither(
        small_arm,
        sampler="halton",
        evaluations=2,
        out=tmp_path / "out",
        protocol=fast,
        settings=small,
    )
    assert found.summary["trials"] == {"sje": 4}


def test_an_unknown_sampler_is_one_clear_line(outside):
    with pytest.raises(StictionError, match=r"unknown sampler 'annealing': expected .*halton"):
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
