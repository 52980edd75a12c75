"""Arms that several tests diagnose."""

from pathlib import Path

import pytest

from stiction_envs.robots import Arm, load_arm
from tests.robots.arms import TWO


@pytest.fixture(scope="session")
def two_xml(tmp_path_factory) -> Path:
    """MJCF of an arm of two joints that feel gravity."""
    path = tmp_path_factory.mktemp("arm") / "two.xml"
    path.write_text(TWO)
    return path


@pytest.fixture(scope="session")
def two(two_xml) -> Arm:
    """The arm."""
    return load_arm(two_xml)
