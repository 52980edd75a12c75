"""Causes that help too little to be believed alone are listed apart."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import diagnose_logs
from tests.gap.small_logs import hidden, panda, sliding

SMALL = ("torque_scale", "torque_offset", "external_spring", "coulomb_friction")


@pytest.mark.parametrize(("offset", "little"), [(0.06, True), (0.12, False)])
def test_what_helps_little_is_listed_apart(offset, little) -> None:
    """Beside a newton metre of friction, an offset below the noise is no reason to mend a robot."""
    fifth = np.eye(7)[4]
    log = hidden(panda(), lambda q, dq, ddq: sliding(q) + offset * fifth, noise=0.2)
    found = diagnose_logs([log], "panda", causes=[cause_named(x) for x in SMALL])
    assert [c.name for c in found.causes] == ["coulomb_friction"] + ["torque_offset"] * (not little)
    assert [c.name for c in found.minor] == ["torque_offset"] * little
    listed = found.to_json()["minor"]
    assert [(x["name"], x["joints"]) for x in listed] == [("torque_offset", [5])] * little
    assert len(found.terms) == 8
