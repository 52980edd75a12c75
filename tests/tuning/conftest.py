"""A two-joint arm and a fast ramp: the whole protocol in seconds."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction_envs.experiments.sje.protocol import Protocol, load_protocol
from stiction_envs.robots import Arm, load_arm
from tests.robots.own_arms import chain


def small(folder: Path) -> tuple[Arm, Protocol]:
    """Return the arm, its file in a folder, and the protocol."""
    path = folder / "small.xml"
    path.write_text(chain(2))
    protocol = load_protocol("small").replace(ramp_rate=2.0, iterations=2, return_time=0.2)
    return load_arm(path), protocol


@pytest.fixture
def small_arm(tmp_path: Path) -> Arm:
    return small(tmp_path)[0]


@pytest.fixture
def fast(tmp_path: Path) -> Protocol:
    return small(tmp_path)[1]
