"""One diagnosis of each kind of log."""

import numpy as np
import pytest

from stiction_envs import diagnose
from stiction_envs.gap.report.results import LogDiagnosis, ServoResult
from stiction_envs.hidden.servo_logs import hide
from tests.gap.servo.small_arm import held, two_links
from tests.gap.small_logs import dry, hidden


@pytest.fixture(scope="package")
def torques(tmp_path_factory: pytest.TempPathFactory) -> LogDiagnosis:
    """A joint log with dry friction."""
    arm = two_links(tmp_path_factory.mktemp("arm"))
    found = diagnose(hidden(arm, dry, seconds=10.0), arm)
    assert isinstance(found, LogDiagnosis)
    assert [c.name for c in found.causes] == ["coulomb_friction"]
    return found


@pytest.fixture(scope="package")
def angles(tmp_path_factory: pytest.TempPathFactory) -> ServoResult:
    """A servo log with dry friction, whose second joint is held for a while."""
    arm = two_links(tmp_path_factory.mktemp("arm"))
    h = hide(arm, ["coulomb_friction"], seed=3, seconds=30.0, start=np.array([-0.6, 0.8]))
    found = diagnose(held(h.log, 20.0, 24.0)[0], arm, **h.options)
    assert isinstance(found, ServoResult)
    assert found.diagnosis.touched[0].any()
    return found
