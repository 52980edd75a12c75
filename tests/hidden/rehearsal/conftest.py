"""A log of a small arm, and what a rehearsal makes of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction_envs.hidden.rehearsal.torque_logs import TorqueLogs
from stiction_envs.robots import Arm, load_arm
from tests.gap.small_logs import dry, found, hidden
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


@pytest.fixture(scope="session")
def logs(two) -> TorqueLogs:
    """The motion of 15 s with dry friction of 0.5 N·m, which a rigid model lacks."""
    return TorqueLogs(found(two, hidden(two, dry)))
