"""What was found is taken for granted, and taken back where it is not found again."""

from __future__ import annotations

from itertools import cycle

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.causes.body.bodies import sphere, with_payload
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.selection import refit
from stiction_envs.robots import Arm
from tests.gap.small_logs import dry, hidden


def stribeck(q, dq, ddq):
    return dry(q, dq, ddq) * (1 + 0.6 * np.exp(-np.square(dq / 0.1)))


def loaded(two: Arm) -> Diagnosis:
    """Diagnose an arm with a payload and friction whose nonlinear parameter is refined."""
    true = with_payload(two, sphere(0.8, np.array([0.02, 0.0, 0.05])), 1e-3)
    log = hidden(two, stribeck, true=true, noise=0.02)
    names = ("coulomb_friction", "stribeck_friction", "payload", "torque_offset")
    return diagnose_logs([log], two, causes=[cause_named(x) for x in names])


def test_what_is_not_found_again_leaves_the_model_as_it_was(
    two: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = loaded(two)
    assert {"payload", "stribeck_friction"} <= {c.name for c in usual.causes}
    assert usual.data.carried is not None
    monkeypatch.setattr(refit, "same_arm_causes", lambda *_: False)
    falling = cycle((1.0, 0.0))
    monkeypatch.setattr(refit, "evidence", lambda *_: next(falling))
    back = loaded(two)
    monkeypatch.setattr(refit, "given_arm_causes", lambda *_: None)
    never = loaded(two)
    assert back.to_json() == never.to_json()
    assert (back.coefficients == never.coefficients).all()
    assert back.data.carried is None
