"""The impedance controller's measurements of arms on paths, and the delay of its commands."""

from __future__ import annotations

import dataclasses

import mujoco
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


@pytest.mark.parametrize("robot", ["iiwa14", "panda"])
def test_joint_torques_are_those_that_move_the_links(robot):
    """Law checked: M q̈ + C q̇ of the links, rotors left out, less what `offset` balances."""
    useless = Sensing(speed_cutoff=100.0)
    rig = following(bench(robot, scatter=False, friction=None, sensing=useless), STILL)
    plant, sticking = rig.plant, rig.plant.sticking
    spec = sticking.arm.spec()
    spec.option.gravity[:] = 0.0
    model = spec.compile()
    data = mujoco.MjData(model)
    acceleration, pushed = (plant.batch.bind(x) for x in ("qacc", "qfrc_applied"))
    log = []
    for _ in range(500):
        outside = pushed[0, sticking.motor].copy()
        link = sticking.link_position(acceleration)[0]
        state = plant.position[0], plant.velocity[0], link, outside
        rig.advance(1)
        log.append((*state, rig.senses.torque[0].copy()))
    q, dq, ddq, outside, measured = (np.array(x) for x in zip(*log, strict=True))
    expected = np.zeros_like(measured)
    for k in range(1, len(log)):  # a step's acceleration belongs to the state before it
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k - 1], dq[k - 1], ddq[k]
        mujoco.mj_inverse(model, data)
        expected[k] = data.qfrc_inverse - outside[k]
    error, size = (np.abs(x[200:]).max(axis=0) for x in (measured - expected, expected))
    assert np.all(error < 0.02 * size + 1e-3)
    assert size.max() > 0.2
