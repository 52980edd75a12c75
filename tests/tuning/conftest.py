"""A two-joint arm and a fast ramp: the whole protocol in seconds."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction_envs.experiments.sje.protocol import Protocol, load_protocol
from stiction_envs.robots import Arm, load_arm
from tests.robots.own_arms import chain


@pytest.fixture
def small_arm(tmp_path: Path) -> Arm:
    path = tmp_path / "small.xml"
    path.write_text(chain(2))
    return load_arm(path)


@pytest.fixture
def fast() -> Protocol:
    return load_protocol("small").replace(ramp_rate=2.0, iterations=2, return_time=0.2)
