"""Settings that make commands on other people's arms short."""

import pytest

from stiction_envs.experiments import conformance
from stiction_envs.experiments.conformance_report import ConformanceSettings
from stiction_envs.identification import excitation, settings
from stiction_envs.method_settings import override
from tests.other_arms.arms import Case

SHORT = {"iterations": 4, "randoms": 2, "starts": 1, "harmonics": 3, "periods": 1}


@pytest.fixture
def case(request, cli, monkeypatch) -> Case:
    """A robot by name, in a folder of its own; searches and holds are short."""
    quick = override(settings.excitation_settings(), SHORT)
    for module in (settings, excitation):
        monkeypatch.setattr(module, "excitation_settings", lambda: quick)
    monkeypatch.setattr(conformance, "USUAL", ConformanceSettings(ramp_rates=(0.5,)))
    return Case(request.param, cli)
