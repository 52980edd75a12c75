"""Torques logged without gravity, against gains, bodies and poses that look like them."""

from functools import cache

import numpy as np
import pytest

from stiction_envs.gap.causes.body.bodies import leaning
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.signals.rigid_body import gravity_torque
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm
from tests.gap.small_logs import dry, hidden, panda


def lacking(share: float, true: Arm | None = None) -> JointLog:
    """A log of the Panda with dry friction that lacks a share of its gravity."""
    model = panda().pinocchio()

    def add(q, dq, ddq):
        return dry(q, dq, ddq) - share * gravity_torque(model, q)

    return hidden(panda(), add, true=true, noise=0.02)


@cache
def diagnosed(share: float) -> Diagnosis:
    return diagnose_logs([lacking(share)], "panda")


@pytest.mark.parametrize("share", [0.03, 1.0])
def test_a_missing_share_is_found_with_friction(share: float) -> None:
    named = {c.name: c for c in diagnosed(share).causes}
    assert set(named) == {"coulomb_friction", "gravity_compensation_missing"}
    mine = named["gravity_compensation_missing"].parameters[0]["share"]
    assert mine.value == pytest.approx(share, rel=0.02)
    assert mine.ci95[0] <= share <= mine.ci95[1]
    assert not mine.on_bound
    assert ("all of it" in named["gravity_compensation_missing"].evidence) == (share == 1.0)


PARTLY = pytest.mark.xfail(strict=True, reason="the verdict comes out as partly explained")


@pytest.mark.parametrize("share", [0.03, pytest.param(1.0, marks=PARTLY)])
def test_a_missing_share_and_friction_explain_the_log(share: float) -> None:
    assert diagnosed(share).verdict == "explained"


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_a_base_that_leans_far_loses_as_much_gravity_as_it_leans(share: float) -> None:
    """A tilt of 0.5 rad alone loses 12 % of gravity; what the log lacks comes on top of it."""
    tilt, azimuth = 0.5, 0.7
    side = np.sin(tilt) * np.array([np.cos(azimuth), np.sin(azimuth)])
    found = diagnose_logs([lacking(share, leaning(panda(), side))], "panda")
    named = {c.name: c for c in found.causes}
    more = {"gravity_compensation_missing"} if share else set()
    assert set(named) == {"coulomb_friction", "base_tilt"} | more
    lean = named["base_tilt"].parameters[0]
    assert lean["tilt_rad"].value == pytest.approx(tilt, rel=0.01)
    assert lean["azimuth_rad"].value == pytest.approx(azimuth, abs=0.02)
    for missing in more:
        value = named[missing].parameters[0]["share"].value
        assert value == pytest.approx(share, abs=0.01)
