"""A log simulated anew: the same motion, noise of the same kind, and what is hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.rehearsal.replay import replay_of, surrogate
from tests.gap.small_logs import RATE, found, hidden
from tests.refusal import refusal


def test_a_surrogate_has_the_spectra_and_the_correlations_and_nothing_else():
    rng = np.random.default_rng(1)
    x = np.cumsum(rng.normal(size=(4000, 2)), axis=0)
    x[:, 1] = 0.7 * x[:, 0] + 0.3 * x[:, 1]
    x -= x.mean(axis=0)
    y = surrogate(x, np.random.default_rng(2))
    np.testing.assert_allclose(*(np.abs(np.fft.rfft(z, axis=0))[1:-1] for z in (x, y)), rtol=1e-6)
    np.testing.assert_allclose(np.corrcoef(y.T), np.corrcoef(x.T), atol=1e-2)
    white = rng.normal(size=(4000, 1))
    again = surrogate(white, np.random.default_rng(3))
    assert abs(np.corrcoef(white[:, 0], again[:, 0])[0, 1]) < 0.06  # 4 standard errors


def test_speeds_and_accelerations_belong_to_the_angles(replay):
    data, slow = replay.data, slice(50, -50)
    step = 1 / RATE
    assert data.dt == step
    speed = np.gradient(data.q, step, axis=0)
    np.testing.assert_allclose(speed[slow], data.dq[slow], atol=2e-4)
    np.testing.assert_allclose(np.gradient(data.dq, step, axis=0)[slow], data.ddq[slow], atol=0.02)
    rigid = inverse_dynamics(data.pinocchio, data.q, data.dq, data.ddq)
    np.testing.assert_allclose(data.nominal, rigid, atol=1e-9)


def test_the_noise_is_that_of_the_log(two):
    """White noise of 0.01 N·m and 1 µrad, and a filter that takes some off."""
    smooth = replay_of(found(two, hidden(two)))
    np.testing.assert_allclose(smooth.left.std(axis=0), 0.01, rtol=0.05)
    np.testing.assert_allclose(smooth.angle_noise, 1e-6, rtol=0.2)
    assert np.all(smooth.noise < 0.01)


def test_friction_is_that_of_the_log(replay):
    np.testing.assert_allclose(replay.friction, 0.5, atol=0.03)
    np.testing.assert_array_equal(replay.unknown_friction, replay.friction)


def test_a_simulated_log_holds_what_is_hidden(replay):
    more = 3.0 + np.zeros_like(replay.data.q)
    (log,) = replay.logs(more, [1])
    (bare,) = replay.logs(np.zeros_like(more), [1])
    np.testing.assert_allclose(log.tau - bare.tau, 3.0, atol=1e-12)
    np.testing.assert_array_equal(log.q, bare.q)
    left = bare.tau - replay.data.nominal
    np.testing.assert_allclose(left.std(axis=0), replay.left.std(axis=0), rtol=1e-3)
    (other,) = replay.logs(more, [2])
    assert not np.array_equal(other.tau, log.tau)


def test_gaps_and_several_logs_stay(two):
    """A gap splits a log, and each log keeps its rows."""
    first, second = hidden(two, seconds=16.0), hidden(two, seconds=10.0, seed=2)
    late = np.where(np.arange(len(first.t)) < 1600, 0.0, 5.0)
    broken = replace(first, t=first.t + late, breaks=(1600,))
    again = replay_of(found(two, broken, second))
    logs = again.logs(np.zeros_like(again.data.q), [1])
    assert [len(log.segments) for log in logs] == [2, 1]
    assert np.diff(logs[0].t).max() > 5.0
    assert [log.source for log in logs] == ["log1.csv", "log2.csv"]
    for log, old in zip(logs, (broken, second), strict=True):
        assert old.t[0] <= log.t[0] < log.t[-1] <= old.t[-1]
        near = np.abs(log.t[:, None] - old.t).argmin(axis=1)
        np.testing.assert_allclose(log.q, old.q[near], atol=2e-5)


def test_poses_cannot_be_rehearsed(two):
    log = hidden(two)
    poses = replace(log, source="poses.csv", t=np.arange(len(log.t)) * 1.0, static=True)
    says = r"log2\.csv: poses at rest: expected joint logs"
    refusal(lambda: replay_of(found(two, log, poses)), says)
