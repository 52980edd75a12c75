"""The generator of blind logs: what each hidden cause does by itself."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.hidden_effects import EFFECTS, World
from stiction_envs.hidden.hidden_logs import _build, _visible_size, make_case
from stiction_envs.hidden.hidden_motions import CENTRE, REACH, one_by_one
from stiction_envs.robots import load_arm


def test_each_of_two_effects_is_measured_by_itself() -> None:
    case = make_case(
        4, ("torque_offset", "torque_scale"), motion="fourier", joint=2, size=0.6, seconds=8.0
    )
    offset = case.hidden[0].values["offset_nm"]
    assert case.alone.shape == (2, 7)
    assert np.isclose(case.alone[0, 1], abs(float(offset)), rtol=0.05)  # type: ignore[arg-type]
    assert np.all(case.effect <= case.alone.sum(axis=0) + 0.02)
    assert case.alone[:, 1].min() > 0.1


def test_a_single_effect_is_the_whole_one() -> None:
    case = make_case(4, ("torque_offset",), motion="fourier", joint=2, size=0.6, seconds=8.0)
    np.testing.assert_array_equal(case.alone, case.effect[None])


def test_a_wrong_link_is_a_body_that_exists() -> None:
    """Its inertia is that of another density: positive, and of a triangle's sides."""
    shift = np.array([0.0, 0.004, -0.003])
    right, wrong = (_build(World(links=x)) for x in ({}, {4: (0.8, shift)}))
    at = right.body("link4").id
    share = 1 + 0.8 / right.body_mass[at]
    assert wrong.body_mass[at] == pytest.approx(right.body_mass[at] + 0.8)
    np.testing.assert_allclose(wrong.body_ipos[at], right.body_ipos[at] + shift)
    np.testing.assert_allclose(wrong.body_inertia[at], share * right.body_inertia[at], rtol=1e-9)
    others = np.arange(right.nbody) != at
    np.testing.assert_array_equal(wrong.body_mass[others], right.body_mass[others])


def test_a_phantom_is_in_the_makers_arm_and_not_in_the_log() -> None:
    options = {"motion": "poses", "seconds": 8.0, "known": False, "second": 4.0}
    case = make_case(3, ("phantom_payload",), **options)  # type: ignore[arg-type]
    mass = case.hidden[0].values["mass_kg"]
    assert case.hidden[0].name == "payload"
    assert isinstance(mass, float)
    assert case.robot.payload is not None
    assert case.robot.payload[0] == -mass > 0.3
    assert case.effect[1] > 0.5
    for log, arm, lacks in (
        (case.logs, case.robot, True),
        (case.logs, load_arm("panda"), False),
        (case.second, load_arm("panda"), False),
    ):
        data = assemble(arm, prepare(log))
        left = np.sqrt(np.mean(data.residual[:, 1] ** 2))
        assert (left > 0.5) == lacks
        assert lacks or left < 0.1


def test_a_smooth_torque_is_what_the_motor_must_overcome() -> None:
    world = World()
    world.hump[2] = 1.5, 0.2, 0.3
    world.harmonics[4, 1] = 0.5, -0.4
    q = np.tile(CENTRE, (3, 1))
    q[:, 2], q[:, 4] = (0.2, 0.5, -1.0), (0.0, 0.7, -0.4)
    torque = world.smooth_torque(q)
    np.testing.assert_allclose(torque[:, 2], 1.5 * np.exp(-0.5 * ((q[:, 2] - 0.2) / 0.3) ** 2))
    np.testing.assert_allclose(torque[:, 4], 0.5 * np.cos(2 * q[:, 4]) - 0.4 * np.sin(2 * q[:, 4]))
    assert not np.delete(torque, [2, 4], axis=1).any()


def test_a_joint_that_reads_off_stands_elsewhere_and_goes_on_from_there() -> None:
    """The arm at the angle less the offset explains the log, the one at the angle does not."""
    options = {"motion": "poses", "seconds": 8.0, "known": False, "joint": 2, "size": 0.8}
    case = make_case(3, ("encoder_offset",), second=4.0, **options)  # type: ignore[arg-type]
    offset = float(case.hidden[0].values["offset_rad"])  # type: ignore[arg-type]
    assert case.effect[1] > 0.5
    for logs in (case.logs, case.second):
        data = assemble(load_arm("panda"), prepare(logs))
        there = data.q - offset * np.eye(7)[1]
        right = inverse_dynamics(data.pinocchio, there, data.dq, data.ddq)
        left = [np.sqrt(np.mean((data.tau - x)[:, 1] ** 2)) for x in (data.rigid, right)]
        assert left[0] > 0.5 > 5 * left[1]


def test_missing_gravity_is_that_share_of_it() -> None:
    options = {"motion": "poses", "seconds": 8.0, "known": False, "size": 0.5}
    case = make_case(5, ("gravity_compensation_missing",), **options)  # type: ignore[arg-type]
    share = float(case.hidden[0].values["share"])  # type: ignore[arg-type]
    data = assemble(load_arm("panda"), prepare(case.logs))
    g = data.recording.gravity[:, 1]
    assert -(data.residual[:, 1] @ g) / (g @ g) == pytest.approx(share, rel=0.02)
    assert case.effect[1] == pytest.approx(share * np.sqrt(np.mean(g**2)), rel=0.1)


def test_of_a_smooth_torque_only_what_is_no_line_can_be_seen() -> None:
    world = World()
    world.harmonics[3, 0] = 0.0, 2.0
    q = np.zeros((400, 7))
    q[:, 3] = np.linspace(-0.05, 0.05, 400)
    effect = np.arange(7.0)
    near = _visible_size(world, q, effect)
    assert near[3] < 1e-4
    np.testing.assert_array_equal(np.delete(near, 3), np.delete(effect, 3))
    q[:, 3] *= 40
    assert _visible_size(world, q, effect)[3] > 0.3


def test_a_second_motion_has_the_same_hidden_and_leaves_the_first_alone() -> None:
    options = {"motion": "fourier", "joint": 2, "size": 0.6, "seconds": 6.0, "known": False}
    once = make_case(4, ("torque_offset",), **options)  # type: ignore[arg-type]
    twice = make_case(4, ("torque_offset",), second=5.0, **options)  # type: ignore[arg-type]
    np.testing.assert_array_equal(once.logs[0].tau, twice.logs[0].tau)
    assert not once.second
    assert twice.second_motion != "fourier"
    assert twice.second[0].t[-1] < 5.1
    more = (twice.second[0].tau - twice.unhidden[0].tau).mean(axis=0)
    assert more[1] == pytest.approx(float(twice.hidden[0].values["offset_nm"]), abs=0.02)  # type: ignore[arg-type]
    assert np.abs(np.delete(more, 1)).max() < 0.02


def test_what_no_log_tells_apart_excludes_each_other() -> None:
    for name, effect in EFFECTS.items():
        assert all(name in EFFECTS[other].excludes for other in effect.excludes)


def test_one_joint_after_the_other_turns_while_the_others_hold() -> None:
    q = one_by_one(np.random.default_rng(2), np.arange(0, 42, 0.02))
    moving = np.abs(np.diff(q, axis=0)) > 1e-4
    assert moving.sum(axis=1).max() == 1
    assert moving.any(axis=0).all()
    np.testing.assert_allclose(np.ptp(q, axis=0), 2 * REACH, rtol=1e-3)
    limits = load_arm("panda").limits
    low, high = limits.position.T
    assert np.all((low < q) & (q < high))
    assert np.all(np.abs(np.gradient(q, 0.02, axis=0)) < limits.velocity)
