"""Torque channels that are turned round or late: seen beyond doubt and undone, or left alone."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks.accuracy.imperfect_arms import presliding
from stiction_envs.gap.signals.loads import Loads, loads
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.rigid_body import gravity_torque, inverse_dynamics
from stiction_envs.gap.signals.torque_lag import correct_torques
from stiction_envs.gap.signals.torque_sign import correct_sign, shared_unit
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm
from tests.gap.small_logs import RATE, hidden, motion, panda, sliding
from tests.refusal import refusal

ARM = panda()


def rub(q, dq, ddq):
    return 0.6 * sliding(q) + 0.3 * dq


@pytest.fixture(scope="module")
def good() -> JointLog:
    return hidden(ARM, rub, noise=0.02)


def with_torque(log: JointLog, tau: np.ndarray, name: str = "made.csv") -> JointLog:
    return dataclasses.replace(log, tau=tau, source=name)


def kinds(log: JointLog) -> list[str]:
    return [c.kind for c in log.corrections]


# ---- sign ----


def wrist_only(sign: float = 1.0, noise: float = 0.02) -> JointLog:
    """Joint 7 turns about its own axis, without friction: all loads are held."""
    good = hidden(ARM, noise=0.0)
    q = np.tile(ARM.rest, (len(good.t), 1))
    q[:, 6] = good.q[:, 6]
    rest = inverse_dynamics(ARM.pinocchio(), q, 0 * q, 0 * q)
    rng = np.random.default_rng(0)
    return dataclasses.replace(good, q=q, tau=sign * (rest + noise * rng.normal(size=q.shape)))


def test_a_load_that_joints_hold_tells_the_sign() -> None:
    """−22 N·m on joint 2 where the model says 22 is no cause of any kind."""
    for sign, found in ((1.0, []), (-1.0, ["sign"])):
        log = wrist_only(sign)
        (corrected,), _ = correct_sign([log], prepare([log]), ARM)
        assert kinds(corrected) == found
        np.testing.assert_array_equal(corrected.tau, sign * log.tau)


@pytest.mark.parametrize("known", [-1, 1])
def test_only_a_changing_load_contradicts_the_sign_that_is_known(good: JointLog, known) -> None:
    still = wrist_only(-known)
    (log,), _ = correct_sign([still], prepare([still]), ARM, known=known)
    assert kinds(log) == (["sign"] if known < 0 else [])
    (log,), _ = correct_sign([good], prepare([good]), ARM, known=known)
    assert kinds(log) == []


def test_logs_of_different_signs_are_refused(good: JointLog) -> None:
    wrong = with_torque(good, -good.tau, "turned.csv")
    logs = [good, wrong]
    says = r"turned\.csv: tau\d has the opposite sign"
    refusal(lambda: correct_sign(logs, prepare(logs), ARM), says)


@pytest.mark.parametrize("masses", [1.0, 5.0])
def test_a_joint_of_the_other_sign_is_inverted(good: JointLog, masses: float) -> None:
    """The sign needs no right masses: real links may be five times as heavy as the model's."""
    heavy = masses * good.tau
    tau = np.array(heavy)
    tau[:, 1] *= -1
    log = with_torque(good, tau)
    (log,), _ = correct_sign([log], prepare([log]), ARM)
    np.testing.assert_array_equal(log.tau, heavy)
    assert "torques of joint 2 have the opposite sign" in log.corrections[0].text


def noise_for_the_most_part(good: JointLog) -> JointLog:
    rng = np.random.default_rng(1)
    load = np.convolve(rng.normal(size=len(good.t)), np.ones(100) / 10, "same")
    return with_torque(good, -good.tau + 20 * load[:, None])


def held_without_gravity(_: JointLog) -> JointLog:
    log = wrist_only()
    return with_torque(log, log.tau - log.tau.mean(axis=0))


@pytest.mark.parametrize("made", [noise_for_the_most_part, held_without_gravity])
def test_a_doubtful_sign_is_left_alone(good: JointLog, made) -> None:
    log = made(good)
    assert correct_sign([log], prepare([log]), ARM)[0][0] is log


# ---- units, channels, mounting, angles ----


def shown(log: JointLog, arm: Arm = ARM) -> Loads:
    return loads(prepare([log]), 0, arm)


def test_a_coarse_sensor_at_rest_is_no_defect() -> None:
    """Friction holds the torque by which the other joints pull at a joint that rests."""
    t, *path = motion(ARM.n, 20.0, 1, 1.0)
    for x in path:
        x[:, 0] = 0.0
    q, dq, ddq = path
    q += ARM.rest
    tau = inverse_dynamics(ARM.pinocchio(), q, dq, ddq)
    assert tau[:, 0].std() > 0.1
    tau[:, 0] = 0.013 * (-1.0) ** np.arange(len(tau))
    found = shown(JointLog(t=t, q=q, dq=dq, tau=tau, source="made.csv"))
    assert found.held.tolist() == [True, *[False] * 6]
    assert found.findings == []


@pytest.mark.parametrize(
    ("tilt", "says"),
    [
        ((np.pi, 0.0), "along +z of the base: mounted on a ceiling? `--tilt 3.14159 0`"),
        ((0.0, np.pi / 2), "along +x of the base: mounted on a wall or a slope? `--tilt 0 1.5708`"),
        ((0.0, 0.0), ""),
    ],
)
def test_gravity_that_points_elsewhere_is_a_mounting(tilt: tuple[float, float], says: str) -> None:
    """Friction and inertia have the right sign, so that the torques have, too."""
    log = hidden(ARM, rub, true=panda(tilt=tilt))
    found = shown(log)
    assert [x for x in found.findings if says not in x or not says] == []
    assert len(found.findings) == bool(says)
    assert correct_sign([log], prepare([log]), ARM)[0][0] is log


def test_a_spring_is_no_mounting(two: Arm) -> None:
    """Gravity from elsewhere explains it a little, but leaves more than half."""
    log = hidden(two, lambda q, dq, ddq: 0.5 * sliding(q) + np.array([3.0, 0.0]) * q)
    assert shown(log, two).findings == []


@pytest.mark.parametrize("joint", [3, 4])
@pytest.mark.parametrize("offset", [None, 1.2, -0.9])
def test_an_angle_that_is_not_the_models_is_named(
    good: JointLog, joint: int, offset: float | None
) -> None:
    q = np.array(good.q)
    q[:, joint - 1] = -q[:, joint - 1] if offset is None else q[:, joint - 1] + offset
    found = shown(dataclasses.replace(good, q=q)).angle
    assert found is not None
    assert found.joint == joint
    if offset is None:
        assert str(found).startswith(f"joint {joint} turns the other way")
    else:
        assert found.offset == pytest.approx(offset, abs=0.05)


# ---- late ----


def delayed(log: JointLog, delay: float, lowpass: float) -> JointLog:
    tau = np.array(log.tau)
    if lowpass:
        k = np.exp(-1 / RATE / lowpass)
        tau = lfilter([1 - k], [1, -k], tau, axis=0, zi=k * tau[:1])[0]
    late = np.stack([np.interp(log.t - delay, log.t, x) for x in tau.T], axis=1)
    return with_torque(log, late)


@pytest.mark.parametrize(("delay", "lowpass"), [(0.12, 0.0), (0.14, 0.0), (0.07, 0.06)])
def test_late_torques_are_brought_forward(good: JointLog, delay: float, lowpass: float) -> None:
    (log,), signals = correct_torques([delayed(good, delay, lowpass)], ARM, prepare)
    assert kinds(log) == ["lag"]
    assert "later than the angles" in log.corrections[0].text
    assert log.corrections[0].lag is not None
    assert sum(log.corrections[0].lag) == pytest.approx(delay + lowpass, abs=0.015)
    # what is left of the delay is noise
    truth = prepare([good])
    inner = slice(100, -100)
    for j in (1, 3):
        right = np.interp(signals.t, truth.t, truth.tau[:, j])
        left = (signals.tau[:, j] - right)[inner].std()
        assert left < 0.15 * right.std()


def test_in_step_or_early_torques_are_left_alone(good: JointLog) -> None:
    """A command that acts late comes before the motion, and what is a little late may be a filter:
    that is a cause, and no correction."""
    for delay in (0.0, -0.03, 0.004, 0.03, 0.08):
        (log,), _ = correct_torques([delayed(good, delay, 0.0)], ARM, prepare)
        assert kinds(log) == []
        assert log.warnings == ()


def test_soft_bristles_are_no_delay() -> None:
    """Friction that builds up over 0.03 rad lags by a way: 0.3 s when slow, 0.04 s when fast.

    Joint 7 turns to and fro at five speeds, a run each, and has no load.
    """
    t, rng = np.arange(0.0, 12.0, 1 / RATE), np.random.default_rng(0)
    way = np.concatenate([np.abs(speed * t % 2 - 1) for speed in (0.1, 0.2, 0.4, 0.6, 0.8)])
    q = np.tile(ARM.rest, (len(way), 1))
    q[:, 6] += way - 0.5
    tau = gravity_torque(ARM.pinocchio(), q) + 0.3 * presliding(q, 0.03)
    log = JointLog(
        source="sweeps.csv",
        t=np.concatenate([t + 13.0 * k for k in range(5)]),
        q=q + 1e-6 * rng.normal(size=q.shape),
        dq=None,
        tau=tau + 0.005 * rng.normal(size=q.shape),
        breaks=tuple(len(t) * k for k in range(1, 5)),
    )
    (log,), _ = correct_torques([log], ARM, prepare)
    assert kinds(log) == []


@pytest.mark.parametrize(
    ("shown", "known", "unit"),
    [
        ([1.02], None, 1.0),
        ([0.08], None, 0.08),
        ([1000.0], None, 1000.0),
        ([3.0], None, 1.0),  # the model may lack masses
        ([], 0.08, 0.08),  # a log that shows nothing is as the diagnosed one
        ([0.09], 0.08, 0.08),
        ([1.02], 0.08, 1.0),  # converted since
        ([12.0], 0.08, 12.0),
    ],
)
def test_the_unit_of_logs_is_what_they_show_and_else_the_known_one(shown, known, unit):
    before = None if known is None else np.full(7, known)
    np.testing.assert_array_equal(np.unique(shared_unit(shown, before)), [unit])
