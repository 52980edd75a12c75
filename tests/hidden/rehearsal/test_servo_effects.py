"""What hidden causes do to a joint under a position servo."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.parameters import HIGH, INDEX, LOW
from stiction_envs.gap.servo.questions import Servo
from stiction_envs.gap.settings import gap_settings
from stiction_envs.hidden.rehearsal.jobs import Job, judge
from stiction_envs.hidden.rehearsal.servo import _base
from stiction_envs.hidden.rehearsal.servo_effects import EFFECTS, ServoJoint, effect_of
from tests.gap.servo.small_arm import motion, parameters

OUTSIDE = {"payload", "external_contact"}
"""Causes that change no parameter of a joint."""
OF_JOINT = sorted(set(EFFECTS) - OUTSIDE)


@pytest.fixture(scope="module")
def moving() -> JointMotion:
    """A joint under gravity that is told slow and fast waves, which its servo follows."""
    t = 0.01 * np.arange(1500)
    command = 0.4 * np.sin(2 * np.pi * 0.2 * t) + 0.05 * np.sin(2 * np.pi * 1.3 * t)
    plain = motion(command, gravity=1.0, slope=0.5)
    return motion(command, q=plain.simulate(parameters(damping=1.0)[None])[0], gravity=1.0)


@pytest.fixture(scope="module")
def joint(moving: JointMotion) -> ServoJoint:
    p = parameters(damping=1.0)
    angle = moving.simulate(p[None])[0]
    return ServoJoint(
        parameters=p,
        friction=0.3,
        gravity=1.0,
        torque=20.0 * float(np.abs(moving.command - angle).max()),
        speed=float(np.abs(np.diff(angle) / np.diff(moving.t)).max()),
        above=0.1,
    )


@pytest.mark.parametrize("name", OF_JOINT)
def test_nothing_hidden_changes_nothing_and_more_changes_more(
    name: str, moving: JointMotion, joint: ServoJoint
) -> None:
    effect = EFFECTS[name]
    without = joint.on_friction() if effect.on_friction else joint
    sizes = effect.largest * np.array([0.0, 0.02, 0.1, 0.5])
    sets = np.stack([without.parameters, *(effect.changed(joint, x) for x in sizes)])
    assert (sets >= LOW).all()
    assert (sets <= HIGH).all()
    plain, *angles = moving.simulate(sets)
    change = [float(np.sqrt(np.mean((a - plain) ** 2))) for a in angles]
    assert change[0] < 1e-9
    # a limit that is not reached changes nothing
    assert change[0] <= change[1] <= change[2] < change[3]


@pytest.mark.parametrize("name", OF_JOINT)
def test_what_is_shown_is_the_parameter_of_the_diagnosis(name: str, joint: ServoJoint) -> None:
    effect, size = EFFECTS[name], 0.3 * EFFECTS[name].largest
    p = dict(zip(INDEX, effect.changed(joint, size), strict=True))
    expected = {
        "servo_stiffness": p["stiffness"],
        "damping": p["damping"],
        "armature": p["armature"],
        "delay": p["delay"],
        "torque_limit": p["torque_limit"],
        "speed_limit": p["speed_limit"],
        "dead_zone": 2.0 * p["dead_zone"],
        "coulomb_friction": p["stiction"] * (1.0 - p["drop"]),
        "stribeck_friction": p["stiction"] * p["drop"],
        "load_dependent_friction": p["load"],
        "presliding_hysteresis": p["stiction"] / p["bristle"],
        "encoder_offset": p["offset"],
        "gravity_compensation_missing": p["compensation"],
    }[name]
    assert effect.shown(joint, size) == pytest.approx(expected)


def test_stribeck_friction_leaves_the_sliding_friction_as_it_is(joint: ServoJoint) -> None:
    p = dict(zip(INDEX, EFFECTS["stribeck_friction"].changed(joint, 0.5), strict=True))
    assert p["stiction"] * (1.0 - p["drop"]) == pytest.approx(joint.friction)


@pytest.mark.parametrize(
    ("named", "verdict", "why"),
    [
        ([["delay", [1], []]], "found", ""),
        ([["servo_lag", [1], ["armature", "damping", "delay"]]], "confused", "damping"),
        ([["servo_lag", [2], ["armature", "damping", "delay"]]], "missed", "nothing is named"),
        ([["delay", [1], []], ["damping", [1], []]], "missed", "named, but damping too"),
    ],
)
def test_a_lag_counts_as_named_for_its_parts(named: list, verdict: str, why: str) -> None:
    job = Job(what=EFFECTS["delay"].what, joints=(0, 1))
    said = judge(job, 1, {"sizes": {}, "named": named, "minor": []})
    assert said.verdict == verdict
    assert why in said.why


@pytest.mark.parametrize(
    ("known", "expected"),
    [
        # nobody said: its own stiffness, and all of its lag as damping
        ({}, {"stiffness": 20.0, "damping": 1.0 + 20.0 * 0.02, "delay": 0.0, "stiction": 0.0}),
        # stiffness alone is known: damping is as it was fitted
        ({"stiffness": np.array([30.0])}, {"stiffness": 30.0, "damping": 1.0, "delay": 0.0}),
        # an earlier model is what it is
        ({"parameters": parameters(damping=0.7, stiction=0.2)[None]}, {"stiction": 0.2}),
    ],
)
def test_with_nothing_hidden_a_joint_is_as_it_is_judged(
    moving: JointMotion, known: dict, expected: dict[str, float]
) -> None:
    found = parameters(damping=1.0, delay=0.02, stiction=0.3)[None]
    own = SimpleNamespace(servo=Servo(**known), parameters=found)
    base = _base(own, [moving], gap_settings())[0]  # type: ignore[arg-type]
    assert {name: base[INDEX[name]] for name in expected} == pytest.approx(expected)


def test_stamps_that_are_late_are_so_once(moving: JointMotion) -> None:
    """In an earlier model and in the log's own diagnosis alike."""
    late = parameters(delay=-0.01)[None]
    own = SimpleNamespace(servo=Servo(parameters=late), parameters=late)
    base = _base(own, [moving], gap_settings())  # type: ignore[arg-type]
    np.testing.assert_array_equal(base, late)


def test_an_unknown_cause_is_one_line() -> None:
    with pytest.raises(StictionError, match="unknown cause 'viscous_friction'") as error:
        effect_of("viscous_friction")
    assert "damping" in str(error.value)
