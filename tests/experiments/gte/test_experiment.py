"""The Generated Trajectory Experiment as a whole: limit cases that can be worked out, same bits."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stiction_envs.control import rotation
from stiction_envs.control.impedance import renew_space
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import Case, load_gte_protocol
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.robots import BUILTIN, load_arm
from tests.control.movements import Segment
from tests.experiments.gte.short_paths import (
    DITHER,
    PATHS,
    SOFT,
    STIFF,
    STILL,
    assert_same,
    bench,
    following,
    one,
)
from tests.refusal import refusal
from tests.robots.arms import chain


def test_tracking_error_without_friction_is_the_impedance_laws():
    """Λ ẍ + D ẋ + K e = 0: integrated with Λ and D of the start for a small movement, 30 mm.

    The reference's own speed is left out of the damping (sources.md 6.1), so the arm lags by
    D ẋ/K even without friction.
    """
    b = bench(kind="none", scatter=False)
    case = Case(trajectory="there", stiffness=SOFT)
    run, rig = one(b, case), following(b, case)
    rig.advance(1)
    a = rig.controller.arrays
    a.null_active[0] = True
    assert renew_space(0, rig.end_effector.jacobian[0], rig._model.mass[0], a)
    inertia, damping = a.inertia[0], -a.gain[0, :, 6:]
    stiffness = -a.gain[0, :, :6]
    segment = Segment(1, b.motion)
    segment.start(np.zeros((1, 3)), STILL[None], PATHS["there"].position, STILL[None])
    x, v, dt, predicted = np.zeros(6), np.zeros(6), 1e-3, []
    for k in range(len(run.time) * 10):
        held = (k // 10) * 10 * dt  # the reference is published at 100 Hz
        wanted = np.append(segment.sample(held)[0][0], np.zeros(3))
        if k % 10 == 0:
            predicted.append(x - wanted)
        v = v + dt * np.linalg.solve(inertia, -stiffness @ (x - wanted) - damping @ v)
        x = x + dt * v
    error, predicted = run.error[0], np.array(predicted)
    size = np.abs(predicted[:, 0]).max()
    assert size > 5e-3
    assert np.abs(error[:, :3] - predicted[:, :3]).max() < 0.1 * size


def test_payload_of_a_wrong_controller_model_deflects_the_arm_by_force_over_stiffness():
    """e = K⁻¹ F: too much gravity is compensated, so the hand is too high, and turned."""
    mass, arm = 0.4, 0.05
    controller_model = load_arm("panda", payload=(mass, arm, 0.0, 0.0))
    b = bench(kind="none", tail=6.0, scatter=False, controller_model=controller_model)
    # where the flange's x axis points at the start: the hand is turned from it
    hand = rotation.from_rpy([0.0, 0.0, load_arm("panda").hand_yaw])
    flange = rotation.multiply(b.rig(1, 1).start_quaternion, hand * [1, -1, -1, -1])
    axis = Rotation.from_quat(np.ravel(flange), scalar_first=True).apply([1.0, 0.0, 0.0])
    for stiffness in (SOFT, STIFF):
        run = one(b, Case(trajectory="stay", stiffness=stiffness))
        error, force = run.error[0, -1], np.array([0.0, 0.0, mass * 9.81])
        np.testing.assert_allclose(error[:3], force / stiffness[0], atol=2e-4)
        turn = np.cross(arm * axis, force) / stiffness[1]
        pose = run.actual[0, -1, 3:], run.reference[0, -1, 3:]
        (apart,) = rotation.rotation_error(*(rotation.from_rpy(p)[None] for p in pose))
        np.testing.assert_allclose(apart[:2], turn[:2], atol=5e-4)


def test_friction_leaves_a_standing_error():
    """Larger than without, and within what the joints' stiction can hold.

    2√K is a quarter of critical damping: without friction it takes 6 s to come to rest.
    """
    case = Case(trajectory="there", stiffness=SOFT)
    sticking = one(bench(tail=3.0, scatter=False), case).error[0]
    free = one(bench(kind="none", tail=6.0, scatter=False), case).error[0]
    assert np.abs(sticking[-1, 0]) > 3e-3 > 10 * np.abs(free[-1, 0])
    still = np.abs(np.diff(sticking[-50:], axis=0)).max()
    assert still < 2e-5


def test_dither_reduces_the_standing_error_and_shakes():
    b = bench(tail=3.0)
    strong = tuple(AmplitudeRow(r.joint, 15.0, 3 * r.amplitude_nm) for r in DITHER)
    cases = [Case(trajectory="there", stiffness=SOFT, dither=rows) for rows in ((), strong)]
    a, d = (Measures(run, b.protocol) for run in b.run(cases, iterations=2))
    plain, shaken = (np.linalg.norm(m.settling[:, -1, :3], axis=1) for m in (a, d))
    assert np.all(shaken < 0.7 * plain)
    assert np.all(d.shaking > 2 * a.shaking)
    assert not a.dither_energy.any()
    assert np.all(d.dither_energy > 0)


GATED = tuple(dataclasses.replace(row, gate_rad_s=0.5) for row in DITHER)
SHAKEN = Case(trajectory="corner", stiffness=STIFF, dither=GATED)


def test_case_does_not_depend_on_the_others():
    """Neither gated dither nor compensation nor a longer path of another case matters."""
    b = bench(threads=2)
    plain = Case(trajectory="there", stiffness=SOFT)
    noise = tuple(AmplitudeRow(j, 40.0, 0.5, "random") for j in (2, 6))
    cases = [
        plain,
        Case(trajectory="corner", stiffness=STIFF, dither=noise),
        SHAKEN,
        dataclasses.replace(plain, compensation=b.compensation("push")),
        dataclasses.replace(SHAKEN, compensation=b.compensation("feedforward", 0.7)),
    ]
    together = b.run(cases, iterations=2)
    for case, run in zip(cases, together, strict=True):
        alone = one(bench(threads=1), case, 2)
        assert len(alone.time) == len(run.time)
        assert_same(alone, run)
        np.testing.assert_array_equal(Measures(alone).window_sum, Measures(run).window_sum)


def test_phases_are_drawn_for_every_joint_and_iteration():
    case = Case(trajectory="there", stiffness=STIFF, dither=DITHER)
    assert len(np.unique(following(bench(), case, 2).dither.phase)) == 14


@pytest.mark.parametrize("robot", BUILTIN)
def test_start_lies_within_limits(robot):
    arm = load_arm(robot)
    low, high = arm.limits.position.T
    assert np.all((arm.rest > low + 0.15) & (arm.rest < high - 0.15))


def test_bad_cases(tmp_path):
    b = bench()
    refusal(lambda: one(b, Case(trajectory="circle", stiffness=SOFT)), "triangle, pentagon, there")
    with pytest.raises(StictionError, match="joint 8"):
        one(b, Case(trajectory="there", stiffness=SOFT, dither=(AmplitudeRow(8, 15.0, 1.0),)))
    says = r"stiffness KT KR KN is .*: expected `float` >= 0"
    refusal(lambda: Case(trajectory="there", stiffness=(200.0, -1.0, 0.0)), says)
    with pytest.raises(StictionError, match="joint 1: 9 rad: expected angles within the limits"):
        bench(start=np.full(7, 9.0))
    refusal(lambda: bench(start=np.zeros(6)), "expected 7 angles")
    refusal(lambda: bench(tool=(0.0, 0.0, np.nan)), "three finite numbers")
    (tmp_path / "two.xml").write_text(chain(2))
    other = load_arm(tmp_path / "two.xml")
    refusal(lambda: bench(controller_model=other), "joints of the arm")
    refusal(lambda: load_gte_protocol().replace(window=0.0), r"window is 0.0: expected .* > 0")
