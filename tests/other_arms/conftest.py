"""Robots of the wheel `example-robot-data`, and settings that make their commands short."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction_envs.experiments import conformance
from stiction_envs.experiments.settings import experiment_settings
from stiction_envs.identification import excitation, settings
from stiction_envs.method_settings import override
from tests.other_arms.arms import Case

SHORT = {"iterations": 4, "randoms": 2, "starts": 1, "harmonics": 3, "periods": 1}


@pytest.fixture
def case(request, tmp_path: Path, monkeypatch) -> Case:
    """A robot by name, in a folder of its own; searches and holds are short."""
    quick = override(settings.identification_settings(), {"excitation": SHORT})
    tests = override(experiment_settings(), {"conformance": {"ramp_rates": [0.5]}})
    for module in (settings, excitation):
        monkeypatch.setattr(module, "identification_settings", lambda: quick)
    monkeypatch.setattr(conformance, "experiment_settings", lambda: tests)
    monkeypatch.chdir(tmp_path)
    return Case(request.param, tmp_path)


def done(case: Case, command: str, *more: object) -> None:
    """Run a command; it must come out."""
    came = case.run(command, *more)
    assert came.code == 0, f"{case.name}, {command}: {came.said}"
