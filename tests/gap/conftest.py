"""Arms that several tests diagnose."""

from __future__ import annotations

import pytest

from stiction_envs.robots import Arm, load_arm
from tests.robots.arms import chain


@pytest.fixture(scope="session")
def two(tmp_path_factory) -> Arm:
    """An arm of two joints that feel gravity."""
    path = tmp_path_factory.mktemp("arm") / "two.xml"
    path.write_text(chain(2, extra='<geom pos="0.15 0 0.1" size="0.05" mass="1"/>'))
    return load_arm(path)
