"""Servo logs in which causes are hidden: sizes, noise, what is found, and its files."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.hidden.rehearsal.jobs import NOTHING
from stiction_envs.hidden.rehearsal.rehearse import Plan, plan
from stiction_envs.hidden.rehearsal.servo_logs import ServoLogs
from stiction_envs.hidden.servo_effects import EFFECTS
from stiction_envs.hidden.servo_logs import ENCODER, HiddenServoLog, hide
from stiction_envs.robots import Arm
from tests.hidden.test_servo_logs import arm as arm

pytestmark = pytest.mark.slow
FEW = ("coulomb_friction", "delay", "payload", "encoder_offset")


@pytest.fixture(scope="module")
def seen(arm: Arm) -> HiddenServoLog:
    return hide(arm, ("coulomb_friction",), seed=3, seconds=45.0, start=np.array([-0.6, 0.8]))


@pytest.fixture(scope="module")
def planned(arm: Arm, seen: HiddenServoLog) -> Plan:
    return plan([seen.log], arm, causes=FEW, **seen.options)


@pytest.fixture(scope="module")
def subject(planned: Plan) -> ServoLogs:
    assert isinstance(planned.subject, ServoLogs)
    return planned.subject


def test_with_nothing_hidden_the_log_is_that_of_the_judged_arm(
    subject: ServoLogs, seen: HiddenServoLog
) -> None:
    """Nothing of the servo's friction is left; steps, times and noise are those of the log."""
    (log,) = subject.logs(subject.base, 0.0, np.random.default_rng(0))
    np.testing.assert_array_equal(log.t, seen.log.t)
    np.testing.assert_array_equal(log.q_cmd, seen.log.q_cmd)
    np.testing.assert_allclose(subject.resolution, ENCODER)
    np.testing.assert_allclose(log.q / ENCODER, np.round(log.q / ENCODER), atol=1e-6)
    assert subject.base[:, 0] == pytest.approx(seen.stiffness)
    # an arm without noise is another by what the diagnosis left, and by rounding
    quiet = copy.copy(subject)
    quiet.left = [np.zeros_like(x) for x in subject.left]
    (silent,) = quiet.logs(subject.base, 0.0, np.random.default_rng(0))
    off = np.sqrt(np.mean((log.q - silent.q) ** 2, axis=0))
    assert (off < 1.5 * subject.noise + ENCODER).all()
    assert (off > 0.5 * subject.noise).all()


def test_sizes_change_the_angle_as_asked(planned: Plan, subject: ServoLogs) -> None:
    (job,) = (x for x in planned.jobs if x.key == "coulomb_friction")
    effect = EFFECTS[job.key]
    for target in (subject.noise, 0.1 * subject.whole):
        size = subject.size(job, target)
        for j, (moving, joint) in enumerate(zip(subject.motions, subject.joints, strict=True)):
            sets = np.stack([joint.parameters, effect.changed(joint, float(size[j]))])
            plain, changed = moving.simulate(sets)
            rms = np.sqrt(np.mean((changed - plain) ** 2))
            assert rms == pytest.approx(target[j], rel=0.1)


def test_smallest_sizes_are_found_without_a_false_alarm(planned: Plan) -> None:
    found = planned.run()
    assert found.named_without == ()
    rows = {(r.cause, r.joint): r for r in found.rows}
    assert all(rows["coulomb_friction", j].smallest_found for j in (1, 2))
    assert all(rows["delay", j].smallest_named for j in (1, 2))
    assert 0.01 < rows["payload", 0].smallest_found < 2.0
    assert rows["delay", 1].unit == "s"


def test_of_unknown_servos_their_own_are_no_false_alarms(arm: Arm, seen: HiddenServoLog) -> None:
    """Their stiffness and lag are no false alarms; the plan says why causes are not hidden."""
    asked = plan([seen.log], arm, causes=["coulomb_friction", "servo_stiffness", "payload"])
    quick = replace(asked, jobs=tuple(j for j in asked.jobs if j.why_not or j.key == NOTHING)).run()
    assert quick.named_without == ()
    reasons = {(x.what.name, row): x.why_not for x in asked.jobs for row in x.rows}
    assert reasons["servo_stiffness", 1] == "nobody said what it should be, so it is named as it is"
    assert "softer ones sag alike" in reasons["payload", 0]
    assert [job.what.name for job in asked.jobs if not job.why_not] == [
        "nothing",
        "coulomb_friction",
    ]
    assert {r.cause for r in quick.rows} == {"servo_stiffness", "payload"}
    assert quick.found == 0
