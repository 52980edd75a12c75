"""A fit of one joint, and the causes that the evidence names on it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.servo.causes import causes_of_joints
from stiction_envs.gap.servo.findings import joint_causes
from stiction_envs.gap.servo.fit import fit
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.joint_search import JointFindings, JointProblem, Question, judge
from stiction_envs.gap.servo.questions import (
    Servo,
    always_fitted,
    possible_causes,
    swing_at_rest,
    without_scale,
)
from stiction_envs.gap.servo.servo_parameters import NAMES, InServo
from tests.gap.servo.small_arm import motion, parameters

CAUSES = {name: cause for name, cause in causes_of_joints().items() if not cause.of_gravity}
ENCODER = 2 * np.pi / 4096


def asked(log: JointMotion, candidates: Mapping[str, InServo] = CAUSES) -> Question:
    return Question(
        motion=log,
        nominal=parameters(damping=1.0),
        always={"delay": 3e-3, "armature": 2e-3, "bristle": 0.5},
        candidates=candidates,
        hypotheses=len(candidates),
        counts=np.ones(len(log.t), dtype=bool),
        floor=ENCODER / np.sqrt(12.0),
    )


def _commands(seconds: float = 40.0) -> np.ndarray:
    """Slow waves, then fast ones on them."""
    t = 0.02 * np.arange(round(50 * seconds))
    slow = 0.4 * np.sin(2 * np.pi * 0.1 * t) + 0.1 * np.sin(2 * np.pi * 0.23 * t)
    return slow + 0.1 * (t > seconds / 2) * np.sin(2 * np.pi * 1.1 * t)


def made(*, noise: np.ndarray | float = 0.0, **values: float) -> JointMotion:
    command = _commands()
    plain = motion(command, step=0.02)
    q = plain.simulate(parameters(**{"damping": 1.0, **values})[None])[0] + noise
    return motion(command, step=0.02, q=np.round(q / ENCODER) * ENCODER)


def _judged(log: JointMotion) -> JointFindings:
    return judge(asked(log))


def test_a_fit_recovers_what_made_a_log() -> None:
    truth = {"damping": 0.9, "stiction": 0.25, "delay": 0.012, "armature": 0.03}
    log = made(**truth)
    problem = JointProblem(asked(log))
    of = problem.coordinates(frozenset({"damping", "coulomb_friction", "delay", "armature"}))
    found = fit(log, problem.noise, of, parameters(damping=0.5, stiction=0.1)[None], 40)
    assert np.sqrt(np.mean(found.error**2)) < 0.4 * ENCODER  # rounding leaves 0.29
    for name, off in (("damping", 0.03), ("stiction", 0.01), ("delay", 2e-3), ("armature", 0.01)):
        assert found[name] == pytest.approx(truth[name], abs=off)


def test_where_nothing_is_hidden_nothing_is_found() -> None:
    assert not _judged(made()).causes


@pytest.mark.parametrize(
    ("cause", "values"),
    [
        ("coulomb_friction", {"stiction": 0.3}),
        ("torque_limit", {"torque_limit": 0.9}),
        ("speed_limit", {"speed_limit": 0.6}),
        ("dead_zone", {"dead_zone": 0.012}),
    ],
)
def test_a_hidden_cause_is_found_alone_and_inside_its_interval(
    cause: str, values: dict[str, float]
) -> None:
    found = _judged(made(**values))
    assert set(found.causes) == {cause}
    ((name, value),) = values.items()
    assert found.fit[name] == pytest.approx(value, rel=0.05)


def test_friction_that_sticks_and_slips_is_no_torque_limit() -> None:
    """Stiction far above the friction in motion: the angle waits and jumps."""
    found = _judged(made(stiction=0.9, drop=0.6, stribeck_velocity=0.05))
    assert set(found.causes) == {"coulomb_friction", "stribeck_friction"}


def test_bursts_that_no_model_has_are_no_torque_limit() -> None:
    """A joint that now and then stays behind by 60 mrad, whatever the torque."""
    t = 0.02 * np.arange(len(_commands()))
    burst = sum(np.exp(-0.5 * ((t - x) / 0.3) ** 2) for x in (6.0, 17.0, 31.0))
    found = _judged(made(stiction=0.3, noise=-0.06 * burst))
    assert set(found.causes) == {"coulomb_friction"}


def test_errors_that_last_need_more_of_them() -> None:
    """The same friction under the same size of errors, for a fiftieth and for a second."""
    rng = np.random.default_rng(1)
    white = rng.normal(size=len(_commands()))
    window = np.exp(-0.5 * (np.arange(-100, 101) / 25.0) ** 2)
    slow = np.convolve(white, window, "same")
    nats = []
    for noise in (white, slow):
        found = _judged(made(stiction=0.2, noise=4e-3 * noise / noise.std()))
        nats.append(found.causes["coulomb_friction"].nats)
    assert nats[1] < 0.6 * nats[0]


def test_a_stated_gain_that_is_a_little_off_is_no_cause() -> None:
    """Nor is it lost: the fit has most of it. One that is far off is named, and the lag is unless
    stated gains may be off.
    """
    each = ((0.84, 0.05, set()), (0.84, 0.0, {"servo_lag"}), (0.6, 0.05, {"damping"}))
    for truth, off, named in each:
        question = asked(made(damping=truth))
        stated = {"damping": off} if off else {}
        found = judge(replace(question, always={**question.always, **stated}))
        assert set(found.causes) == named
        assert abs(found.fit["damping"] - truth) < 0.5 * (1.0 - truth)


def test_a_part_of_the_lag_whose_interval_contains_the_nominal_value_is_named_as_lag() -> None:
    """Beside delay and armature, damping may be as stated; the sum of the three cannot."""
    (lag,) = joint_causes({0: _judged(made(damping=0.84))}, np.full(1, 1e-3))
    low, high = lag.parameters[1]["lag_s"].ci95
    assert lag.name == "servo_lag"
    assert low < 0.84 / 20.0 < high < 1.0 / 20.0  # damping over stiffness; stated: 1.0


def test_another_cause_whose_interval_contains_the_nominal_value_is_not_named(monkeypatch) -> None:
    """As if the interval of stiction contained zero."""
    monkeypatch.setattr(
        JointProblem, "vague", lambda _, causes, of: {"stribeck_friction"} & {*causes}
    )
    found = _judged(made(stiction=0.9, drop=0.6, stribeck_velocity=0.05))
    assert set(found.causes) == {"coulomb_friction"}
    assert found.fit["drop"] == 0.0


def test_a_rotor_is_not_named_where_nothing_sets_the_scale_of_torques() -> None:
    """A joint without gravity under an unknown servo, which is taken to be five times as stiff."""
    log, nominal, named = made(), parameters(stiffness=100.0), []
    for servo in (Servo(), Servo(same=True)):  # the second has the stiffness of other joints
        always = always_fitted(servo, log, np.zeros(2), nominal, False)
        question = asked(log, possible_causes(servo, log, ENCODER, False))
        free = without_scale(servo, False)
        question = replace(question, nominal=nominal, always=always, without_scale=free)
        named.append(set(judge(question).causes))
    assert named == [{"damping"}, {"damping", "armature"}]


def test_a_small_error_of_a_stated_gain_takes_no_part_of_what_a_cause_takes_off() -> None:
    question = asked(made(damping=0.5))
    found = judge(replace(question, always={**question.always, "damping": 0.05}))
    assert set(found.causes) == {"damping"}
    error = question.motion.q - question.motion.simulate(question.nominal[None])[0]
    assert found.causes["damping"].lost == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.2)


def test_a_swing_counts_where_the_command_has_rested_for_a_while() -> None:
    t = 0.02 * np.arange(500)
    moving = motion(np.minimum(t, 4.0), step=0.02)
    swing = 0.1 * np.sin(2 * np.pi * t)
    assert swing_at_rest(moving, moving.command + swing) == pytest.approx(
        0.1 / np.sqrt(2), rel=0.02
    )
    assert swing_at_rest(moving, np.where(t < 4.9, t, 4.0)) < 1e-12
    assert swing_at_rest(motion(t, step=0.02), t + swing) == 0.0


def test_what_moves_the_joint_has_more_than_what_is_named() -> None:
    """Friction that falls a little with speed is not named, and yet in the motion elsewhere."""
    rng = np.random.default_rng(3)
    log = made(stiction=0.2, drop=0.12, noise=2e-3 * rng.standard_normal(2000))
    found = _judged(log)
    assert set(found.causes) == {"coulomb_friction"}
    assert found.fit["drop"] == 0.0
    names = {NAMES[k] for k in found.predicting.coordinates.at}
    assert {"stiction", "drop", "damping", "armature", "delay"} <= names
    assert found.predicting.log_likelihood > found.fit.log_likelihood
