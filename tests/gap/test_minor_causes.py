"""Causes that help too little to be believed alone are listed apart."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import diagnose_logs
from tests.gap.small_logs import hidden, panda, sliding

NAMES = ("torque_scale", "coulomb_friction", "viscous_friction")


@pytest.mark.parametrize(("slope", "little"), [(0.05, True), (1.0, False)])
def test_what_helps_little_is_listed_apart(slope, little) -> None:
    """Beside a newton metre of friction on all joints, a slope of one is no reason to mend it."""
    fifth = np.eye(7)[4]
    log = hidden(panda(), lambda q, dq, ddq: sliding(q) + slope * fifth * dq, noise=0.02)
    found = diagnose_logs([log], "panda", causes=[cause_named(x) for x in NAMES])
    others = ["viscous_friction"] * (not little)
    assert [c.name for c in found.causes] == ["coulomb_friction", *others]
    assert [c.name for c in found.minor] == ["viscous_friction"] * little
    listed = found.to_json()["minor"]
    assert [(x["name"], x["joints"]) for x in listed] == [("viscous_friction", [5])] * little
