"""A log of a small arm, and what a rehearsal makes of it."""

import pytest

from stiction_envs.hidden.rehearsal.torque_logs import TorqueLogs
from tests.gap.conftest import two as two
from tests.gap.conftest import two_xml as two_xml
from tests.gap.small_logs import dry, found, hidden


@pytest.fixture(scope="session")
def logs(two) -> TorqueLogs:
    """The motion of 15 s with dry friction of 0.5 N·m, which a rigid model lacks."""
    return TorqueLogs(found(two, hidden(two, dry)))
