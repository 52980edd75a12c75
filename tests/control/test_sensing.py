"""Senses against the laws of noise, delay and quantisers (sources.md 8)."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.control.sensing import Senses, Sensing, load_sensing
from stiction_envs.control.sensing_kernels import sense_arm
from stiction_envs.control.torque_path import low_pass_gain
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import load_arm
from tests.refusal import refusal
from tests.robots.arms import write_arms

SEED = np.array([7], dtype=np.uint64)


def read_all(sensing, q, *, hold=1, seeds=SEED, dq=None):
    """Read (N, K, n) states control step by control step: angles and speeds (2, N, K, n)."""
    nsim, steps, n = q.shape
    senses = Senses(sensing, nsim, n, hold_steps=hold)
    senses.reset(np.arange(nsim), q[:, 0], np.resize(seeds, nsim))
    out = np.empty((2, *q.shape))
    for k in range(steps):
        for i in range(nsim):
            true = [np.zeros(n) if x is None else x[i, k] for x in (q, dq)]
            sense_arm(k % hold == 0, i, k, *true, senses.arrays)
        out[:, :, k] = senses.q, senses.dq
    return out


def phase_of(signal, wave):
    """Phase of a signal (K,) against exp(iωt) of the same steps [rad]."""
    return float(np.angle(np.sum(signal * np.conj(wave))))


def test_only_senses_without_errors_are_ideal():
    assert Sensing().is_ideal
    for field in dataclasses.fields(Sensing):
        if field.name != "speed":
            assert not Sensing(**{field.name: 0.01}).is_ideal, field.name
    assert not Sensing(speed="difference").is_ideal


@pytest.mark.parametrize(("hold", "cutoff"), [(1, 0.0), (1, 40.0), (5, 8.0)])
def test_noise_of_angles_gives_the_difference_the_variance_that_theory_says(hold, cutoff):
    """Law checked: 2σ²g²/((2 − g) T²), sources.md 8.1."""
    sigma, steps = 1e-4, 20_000 * hold
    sensing = Sensing(speed="difference", angle_noise=sigma, speed_cutoff=cutoff)
    q, dq = read_all(sensing, np.full((1, steps, 2), 0.3), hold=hold)[:, 0, 1000::hold]
    assert q.std(axis=0) == pytest.approx([sigma] * 2, rel=0.03)
    period = hold * CONTROL_DT
    gain = low_pass_gain(cutoff, period)
    expected = sigma * gain * np.sqrt(2 / (2 - gain)) / period
    assert dq.std(axis=0) == pytest.approx([expected] * 2, rel=0.05)


def test_noise_of_logged_speeds_has_its_deviation():
    sensing = Sensing(speed_noise=(0.003, 0.0))
    q = np.zeros((200, 200, 2))
    _, dq = read_all(sensing, q, seeds=np.arange(200, dtype=np.uint64))
    assert dq[..., 0].std() == pytest.approx(0.003, rel=0.02)
    assert not dq[..., 1].any()


@pytest.mark.parametrize("delay", [0.001, 0.003, 0.0047, 0.02])
def test_a_delay_shifts_the_phase_by_2_pi_f_d(delay):
    frequency, steps = 20.0, 1000
    wave = np.exp(2j * np.pi * frequency * np.arange(steps) * CONTROL_DT)
    sensing = Sensing(measurement_delay=delay, command_delay=delay)
    state = np.repeat(wave.imag[None, :, None], 2, axis=2)
    seen = read_all(sensing, state, dq=state)[:, 0, 100:]
    line = Senses(sensing, 1, 2)
    line.reset(np.array([0]), np.zeros((1, 2)), SEED)
    sent = state.copy()
    line.send_block(np.array([0]), np.arange(steps)[None], sent)
    zero = phase_of(wave.imag[100:], wave[100:])
    for signal in (*seen[:, :, 0], sent[0, 100:, 0]):
        lag = (zero - phase_of(signal, wave[100:])) % (2 * np.pi)
        assert lag == pytest.approx(2 * np.pi * frequency * delay, rel=2e-3)


def test_a_logged_speed_lags_slow_motion_by_its_time_constant():
    time = np.arange(2000) * CONTROL_DT
    speed = np.repeat(time[None, :, None], 2, axis=2)
    sensing = Sensing(speed_lag=(0.005, 0.0))
    seen = read_all(sensing, np.zeros_like(speed), dq=speed)[1, 0, -1]
    assert time[-1] - seen == pytest.approx([0.005, 0.0], abs=1e-9)


def test_readings_are_held_between_cycles():
    q = np.random.default_rng(0).normal(size=(1, 100, 3))
    seen = read_all(Sensing(speed_cutoff=1.0), q, hold=5)[0, 0]
    assert np.array_equal(seen, np.repeat(q[0, ::5], 5, axis=0))


def test_blocks_of_control_steps_are_read_as_single_steps():
    rng = np.random.default_rng(0)
    q = np.cumsum(rng.normal(size=(2, 61, 3)), axis=1) * 1e-3
    sensing = Sensing(
        angle_noise=1e-4,
        angle_resolution=1e-5,
        speed_lag=0.005,
        measurement_delay=0.0023,
    )
    speed = np.diff(q, axis=1, prepend=q[:, :1]) / CONTROL_DT
    expected = read_all(sensing, q, hold=5, dq=speed)
    senses = Senses(sensing, 2, 3, hold_steps=5)
    senses.reset(np.arange(2), q[:, 0], np.resize(SEED, 2))
    seen = []
    for part in (slice(1, 4), slice(4, 50), slice(50, 61)):
        steps = np.tile(np.arange(61)[part], (2, 1))
        seen.append(senses.read_block(np.arange(2), steps, q[:, part]))
    assert np.array_equal(np.concatenate(seen, axis=1)[:, 5:], expected[0][:, 6:])
    assert np.array_equal(senses.dq, expected[1][:, -1])


def test_a_lost_command_is_the_one_before():
    """FCI reuses the torque of the last packet that it received (sources.md 8.2)."""
    line = Senses(Sensing(missed_cycles=0.2), 3, 2, hold_steps=2)
    line.reset(np.arange(3), np.zeros((3, 2)), np.arange(3, dtype=np.uint64))
    sent = np.tile(1.0 + np.arange(4000.0)[:, None], (3, 1, 2))
    arrived = sent.copy()
    line.send_block(np.arange(3), np.tile(np.arange(4000), (3, 1)), arrived)
    kept = np.diff(arrived[..., 0], axis=1, prepend=0.0) == 0.0
    assert np.array_equal(arrived[~kept], sent[~kept])
    assert kept[:, 1::2].all()
    lost = kept[:, ::2].sum()
    assert lost / 6000 == pytest.approx(0.2, abs=4 * np.sqrt(0.2 * 0.8 / 6000))


def test_angles_are_multiples_of_their_resolution():
    q = np.random.default_rng(0).normal(size=(1, 100, 2))
    seen = read_all(Sensing(angle_resolution=(0.25, 0.0)), q)
    assert np.abs(seen[0, 0, 1:, 0] - q[0, 1:, 0]).max() <= 0.125
    assert np.array_equal(seen[0, 0, :, 1], q[0, :, 1])
    steps = seen[0, 0, :, 0] * 4
    assert np.array_equal(steps, np.rint(steps))


def test_a_toml_has_fields_plain_or_with_their_source(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        '[sensing]\nspeed = "difference"\nangle_noise = [1e-5, 2e-5, 0, 0, 0, 0, 0]\n'
        'command_delay = { value = 0.002, unit = "s", source = "me" }\n'
    )
    noise = (1e-5, 2e-5, 0.0, 0.0, 0.0, 0.0, 0.0)
    expected = Sensing(speed="difference", angle_noise=noise, command_delay=0.002)
    assert load_sensing(load_arm("panda"), path) == expected
    assert load_sensing(load_arm("panda"), expected) is expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("angle_noise = -1.0", "angle_noise is -1.0: expected `float` >= 0"),
        ("angle_noise = [1e-5, 1e-5]", "angle_noise of 2 joints: expected 7, or one"),
        ("command_delay = [0.1]", "command_delay is .*: expected `float`"),
        ("command_delay = 1.0", "command_delay is 1.0: expected `float` <= 0.1"),
        ("angle_noise = inf", "angle_noise is inf: expected finite numbers"),
        ("angle_noise = nan", "angle_noise is nan: expected finite numbers"),
        ('angle_noise = "x"', "angle_noise is 'x': expected `float | array`"),
        ("missed_cycles = 1.0", "missed_cycles is 1.0: expected `float` < 1"),
        ('speed = "guess"', "speed is 'guess': "),
        ("noise = 1.0", "noise: no such setting: expected one of speed, angle_resolution"),
    ],
)
def test_bad_numbers_are_named(tmp_path, text, words):
    path = tmp_path / "bad.toml"
    path.write_text(f"[sensing]\n{text}\n")
    assert str(path) in refusal(lambda: load_sensing(load_arm("panda"), path), words)


def test_senses_that_are_not_known_are_refused(tmp_path):
    refusal(lambda: load_sensing(load_arm("panda"), "nothing"), "ideal, robot, or an existing TOML")
    refusal(lambda: load_sensing(load_arm("panda"), 3), "expected ideal, robot, a TOML or Sensing")
    other = tmp_path / "other.toml"
    other.write_text("[limits]\n")
    refusal(lambda: load_sensing(load_arm("panda"), other), r"expected a table \[sensing\]")
    own = load_arm(write_arms(tmp_path) / "two.urdf")
    refusal(lambda: load_sensing(own, "robot"), r"has no table \[sensing\], only .*panda")
