"""Arms that several tests diagnose."""

from __future__ import annotations

import pytest

from stiction_envs.robots import Arm, load_arm
from tests.robots.arms import TWO


@pytest.fixture(scope="session")
def two(tmp_path_factory) -> Arm:
    """An arm of two joints that feel gravity."""
    path = tmp_path_factory.mktemp("arm") / "two.xml"
    path.write_text(TWO)
    return load_arm(path)
