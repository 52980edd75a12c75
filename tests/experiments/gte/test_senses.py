"""The impedance controller's measurements of arms on paths, and the delay of its commands."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.control.sensing import Sensing
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.plant import CONTROL_DT
from tests.experiments.gte.short_paths import DITHER, SOFT, bench, following, one

STILL = Case(trajectory="there", stiffness=SOFT)
GATED = tuple(dataclasses.replace(row, gate_rad_s=0.3) for row in DITHER)
THERE = dataclasses.replace(STILL, dither=GATED)


@pytest.mark.parametrize("robot", ["panda", "iiwa14"])
def test_senses_without_errors_change_nothing(robot):
    """All of the machinery runs, the corner of a filter that is not used tells it from ideal."""
    useless = Sensing(speed_cutoff=100.0)
    assert not useless.is_ideal
    case = dataclasses.replace(STILL, dither=DITHER)
    ideal, seen = (one(bench(robot, sensing=s), case) for s in ("ideal", useless))
    assert len(ideal.time) == len(seen.time) > 100
    np.testing.assert_allclose(seen.actual, ideal.actual, atol=1e-9)
    np.testing.assert_allclose(seen.accepted, ideal.accepted, atol=1e-9)


def test_the_controller_has_the_angles_that_were_read():
    """Pose, Jacobian, speed and mass are those of the measured angles; samples are true."""
    delay = 0.004
    rig = following(bench(sensing=Sensing(measurement_delay=delay), scatter=False), STILL)
    states = []

    for _ in range(200):
        state = rig.plant.position, rig.plant.velocity
        rig.advance(1)
        seen = rig.senses.q.copy(), rig.senses.dq.copy(), rig.seen_end_effector.position.copy()
        states.append((*state, *seen, rig.end_effector.position.copy()))
    q, dq, seen_q, seen_dq, seen_x, x = (np.array(s) for s in zip(*states, strict=True))
    late = round(delay / CONTROL_DT)
    assert np.abs(dq).max() > 1e-3
    np.testing.assert_array_equal(seen_q[late:], q[:-late])
    np.testing.assert_array_equal(seen_dq[late:], dq[:-late])
    np.testing.assert_allclose(seen_x[late:], x[:-late], atol=1e-12)
    np.testing.assert_array_equal(rig.controller.arrays.q, rig.senses.q)


def test_commands_act_later():
    late = 3
    free = {"scatter": False, "sensing": Sensing(command_delay=late * CONTROL_DT)}
    rig = following(bench(**free), STILL)
    sent, acting = [], []
    for _ in range(100):
        rig.advance(1)
        sent.append(rig.controller.command.copy())
        acting.append(rig.senses.sent.arrived.copy())
    assert np.abs(sent).max() > 0.1
    np.testing.assert_array_equal(acting[late:], sent[:-late])
    assert not np.any(acting[:late])
