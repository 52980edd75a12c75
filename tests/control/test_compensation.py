"""Friction compensation: its law, tables, and a joint whose friction it takes away exactly."""

import pickle

import numpy as np
import pytest

from stiction_envs.control.compensation import (
    Compensation,
    Compensations,
    Compensator,
    compensate,
    look_ahead,
)
from stiction_envs.control.impedance import CartesianImpedance, ImpedanceSettings
from stiction_envs.friction.parameters import load_friction
from stiction_envs.robots import load_arm
from tests.control.rig import poses
from tests.refusal import refusal

N, JOINTS = 64, 7


def loads(compensation: Compensation | None, nsim: int = N) -> Compensations:
    out = Compensator(nsim, JOINTS, damping=0.2)
    out.set_rows(np.arange(nsim), [compensation] * nsim)
    return out.arrays


def compensated(c: Compensations, dq: np.ndarray, *, shift: np.ndarray) -> np.ndarray:
    """Torque (N, n) of arms whose references are ``shift`` (N, 3) [m] away, K = 200/20."""
    look = poses(N)
    control = CartesianImpedance(ImpedanceSettings(), N, load_arm("panda").limits)
    control.reset(np.arange(N), look.position + shift, look.quaternion, look.q)
    for i in range(N):
        compensate(i, *look[:3], dq, look.mass, control.arrays, c)
    return c.torque.copy()


GAIN = (0.7, 0.9, 0.6, 1.0, 0.5, 0.4, 0.6)


def test_feedforward_is_the_law():
    """g tanh(q̇_d/v) with q̇_d = Jᵀ(JJᵀ + λ²)⁻¹ ẋ_d; nothing where the reference rests."""
    look, rng = poses(N), np.random.default_rng(0)
    twist = 0.1 * rng.normal(size=(N, 6))
    twist[3] = 0.0
    c = loads(Compensation(kind="feedforward", gain=GAIN, speed=(0.05,)))
    assert c.feeds.all()
    for i in range(N):
        look_ahead(i, look.jacobian[i], twist[i], c)
    jj = look.jacobian @ look.jacobian.transpose(0, 2, 1) + 0.2**2 * np.eye(6)
    solved = np.linalg.solve(jj, twist[..., None])
    speed = (look.jacobian.transpose(0, 2, 1) @ solved)[..., 0]
    np.testing.assert_allclose(c.wanted_speed, speed, atol=1e-12)
    torque = compensated(c, rng.normal(size=(N, JOINTS)), shift=np.ones((N, 3)))
    np.testing.assert_allclose(torque, GAIN * np.tanh(speed / 0.05), atol=1e-12)
    assert not torque[3].any()


def test_push_is_the_law():
    """g tanh(e_j/w) exp(−(q̇_j/v)²); turned by e_j, joint j alone asks nothing more of K."""
    look, rng = poses(N), np.random.default_rng(1)
    shift = 0.03 * rng.normal(size=(N, 3))
    dq = 0.05 * rng.normal(size=(N, JOINTS))
    c = loads(Compensation(kind="push", gain=GAIN, speed=(0.04,), error=(0.02,)))
    assert not c.feeds.any()
    torque = compensated(c, dq, shift=shift)
    k, jac = np.diag([200.0] * 3 + [20.0] * 3), look.jacobian
    ahead = np.concatenate([shift, np.zeros((N, 3))], axis=1)
    pull = np.einsum("nkj,kl,nl->nj", jac, k, ahead)
    error = pull / np.einsum("nkj,kl,nlj->nj", jac, k, jac)
    for j in range(JOINTS):
        rest = ahead - jac[:, :, j] * error[:, j, None]
        np.testing.assert_allclose(np.einsum("nk,kl,nl->n", jac[:, :, j], k, rest), 0, atol=1e-10)
    expected = GAIN * np.tanh(error / 0.02) * np.exp(-((dq / 0.04) ** 2))
    np.testing.assert_allclose(torque, expected, atol=1e-12)
    assert np.all(torque * pull > -1e-24)  # rounding, where there is no pull


def test_gains_are_the_breakaway_torques():
    p = load_friction("panda", 7)
    c = Compensation.from_friction("push", p, 0.7)
    np.testing.assert_allclose(c.gain, 0.7 * p.stiction_at(np.zeros(7)).mean(axis=1))
    loaded = Compensation.from_friction("push", p, load=np.full(7, 10.0))
    np.testing.assert_allclose(loaded.gain, p.stiction_at(np.full(7, 10.0)).mean(axis=1))
    assert not np.allclose(loaded.gain, np.array(c.gain) / 0.7)
    assert c == Compensation.from_friction("push", p, 0.7)
    assert hash(c) != hash(loaded)
    assert {len(x) for x in c.numbers.values()} == {c.n} == {7}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "pull"}, "'pull': expected one of feedforward, push"),
        ({"gain": (1.0, -1.0)}, "gain of joint 2 is -1"),
        ({"gain": ()}, "one number per joint"),
        ({"gain": (1.0, np.nan)}, "finite"),
        ({"gain": "much"}, "gain is a str: expected finite numbers"),
        ({"speed": (0.1, 0.0)}, "speed of joint 2 is 0"),
        ({"speed": (0.1, 0.1, 0.1)}, "one number, or 2"),
        ({"error": -1.0}, "error of joint 1"),
        ({"load": -1.0}, "load of joint 1 is -1"),
        ({"kind": "feedforward", "error": 0.1}, "feedforward has none: expected speed"),
        ({"kind": "momentum_observer", "share": 1.1}, "share of joint 1 is 1.1: .* 1 and <= 1"),
        ({"kind": "momentum_observer", "rate": 0.0}, "rate of joint 1 is 0: expected > 0"),
        ({"kind": "lugre_observer", "speed": 0.1}, "lugre_observer needs it"),
    ],
)
def test_bad_numbers(change, words):
    refusal(lambda: Compensation(**({"kind": "push", "gain": (1.0, 1.0)} | change)), words)


def test_compensation_that_does_not_fit_is_refused():
    refusal(lambda: loads(Compensation(kind="push", gain=(1.0, 1.0))), "2 joints: expected 7")
    p = load_friction("panda", 7)
    refusal(lambda: Compensation.from_friction("push", p, -1), "factor is -1")


def test_a_copy_has_the_addresses_of_its_process():
    c = Compensator(2, JOINTS, damping=0.2)
    c.set_rows(np.array([1]), [Compensation(kind="push", gain=GAIN)])
    expected = c.arrays.law.copy()
    assert expected[0] == 0 != expected[1]
    c.arrays.law[:] = 1  # an address of another process
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(c)).arrays.law, expected)
