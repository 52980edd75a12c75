"""The torque path: hold, rate limit, low-pass, torque limit. sources.md 1.8 and 2.6."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from stiction_envs.control.torque_path import (
    CONTROL_RATE_HZ,
    TorqueInterface,
    TorquePath,
    pass_torque,
)
from stiction_envs.errors import StictionError
from stiction_envs.robots import load_arm
from tests.refusal import refusal

DT = 1.0 / CONTROL_RATE_HZ


def interface(**changes: object) -> TorqueInterface:
    fields: dict[str, object] = {
        "controller_rate_hz": 1000,
        "lowpass_hz": 0.0,
        "torque_rate": np.array([np.inf, np.inf]),
        "torque_limit": np.array([np.inf, np.inf]),
    }
    return TorqueInterface(**(fields | changes))  # type: ignore[arg-type]


def sine(hz: float, amplitude: float) -> np.ndarray:
    """One second of a sine."""
    return amplitude * np.sin(2 * np.pi * hz * np.arange(1000) * DT)


def through(command: np.ndarray, **changes: object) -> np.ndarray:
    """Pass a series [N·m] on the first of two joints; the other one gets its negative."""
    path = TorquePath(interface(**changes), 1)
    out = path.run(np.stack([command, -command], axis=1)[None], np.arange(1))[0]
    np.testing.assert_array_equal(out[:, 1], -out[:, 0])
    return out[:, 0]


def test_lowpass_is_scipys_to_the_bit():
    rng = np.random.default_rng(3)
    u = rng.normal(size=(4, 150, 2)).cumsum(axis=1)
    path = TorquePath(interface(lowpass_hz=100.0), 4)
    start = rng.normal(size=(4, 2))
    path.reset(np.arange(4), start)
    out = np.concatenate([path.run(b, np.arange(4)) for b in np.split(u, 3, axis=1)], axis=1)
    g = interface(lowpass_hz=100.0).lowpass_gain
    expected, _ = lfilter([g], [1.0, g - 1.0], u, axis=1, zi=(1.0 - g) * start[:, None])
    np.testing.assert_array_equal(out, expected)


LIMITED = {"torque_rate": np.array([1000.0, 1000.0])}


def test_rate_limit_saturates_the_sine_of_sources_1_8():
    """2πfA: 3.2 N·m at 80 Hz is 1608 N·m/s and is cut; the output is a triangle of 1 N·m/ms."""
    u = sine(80, 3.2)
    y = through(u, **LIMITED)
    assert np.abs(np.diff(y)).max() == pytest.approx(1.0, abs=1e-12)
    # a saturated sine turns into a triangle of rate × quarter period at least where cut most
    assert np.abs(y).max() < 0.99 * np.abs(u).max()
    last = np.arange(800, 1000)  # 16 periods
    wave = np.exp(-2j * np.pi * 80 * last * DT)
    response = (y[last] @ wave) / (u[last] @ wave)
    assert abs(response) < 0.98
    assert np.degrees(np.angle(response)) < -5


def test_rate_limit_comes_before_the_low_pass():
    """A step is first a ramp, then filtered: its first sample is g × 1 N·m."""
    y = through(np.full(50, 10.0), **LIMITED, lowpass_hz=100.0)
    g = interface(lowpass_hz=100.0).lowpass_gain
    assert y[0] == pytest.approx(g * 1.0)
    assert y[1] == pytest.approx(g * 1.0 + g * (2.0 - g))


def test_torque_limit():
    y = through(sine(10, 20.0), torque_limit=np.array([12.0, 12.0]))
    assert y.max() == 12.0
    assert y.min() == -12.0
    small = sine(10, 11.0)
    assert through(small, torque_limit=np.array([12.0, 12.0])).tobytes() == small.tobytes()


@pytest.mark.parametrize("lowpass", [0.0, 100.0])
@pytest.mark.parametrize("amplitude", [0.5, 1.9, 6.0])
def test_any_split_gives_the_same_bits(lowpass, amplitude):
    """One run of 40 steps is two of 20, 40 of one, and 40 cycles of a feedback law."""
    rng = np.random.default_rng(1)
    u = amplitude * np.sin(rng.uniform(0, 9, (3, 1, 2)) + 0.5 * np.arange(40)[None, :, None])
    kwargs = LIMITED | {"lowpass_hz": lowpass, "torque_limit": np.array([4.0, 2.0])}
    outs, ids = [], np.arange(3)
    for size in (40, 20, 8, 1):
        path = TorquePath(interface(**kwargs), 3)
        parts = [path.run(u[:, k : k + size], ids) for k in range(0, 40, size)]
        outs.append(np.concatenate(parts, axis=1))
    path, cycles = TorquePath(interface(**kwargs), 3), np.empty_like(u)
    for k in range(40):
        for i in range(3):
            pass_torque(i, u[:, k], path.arrays, cycles[:, k])
    for out in (*outs[1:], cycles):
        assert out.tobytes() == outs[0].tobytes()


def test_tick():
    path = interface(controller_rate_hz=200)
    assert path.hold_steps == 5
    assert path.tick(np.arange(11)).tolist() == [0] * 5 + [5] * 5 + [10]
    assert interface().tick(np.arange(4)).tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("rate", [0, -200, 300, 2000, 333.3, 0.5, np.nan, np.inf])
def test_rates_must_divide_1000(rate):
    with pytest.raises(StictionError, match=r"controller rate .*divisors of 1000 Hz"):
        replace(TorqueInterface.of(load_arm("panda")), controller_rate_hz=rate)


@pytest.mark.parametrize("cutoff", [-1.0, float("nan"), float("inf")])
def test_cutoff_must_be_finite(cutoff):
    refusal(lambda: interface(lowpass_hz=cutoff), "low-pass")


def test_interfaces_of_the_arms():
    arm = load_arm("panda")
    panda, iiwa = TorqueInterface.of(arm), TorqueInterface.of(load_arm("iiwa7"))
    assert (panda.controller_rate_hz, panda.lowpass_hz) == (1000, 100.0)
    assert panda.torque_rate is arm.limits.torque_rate
    assert panda.torque_limit is arm.limits.torque
    assert iiwa.controller_rate_hz == 200
    slower = replace(panda, controller_rate_hz=500, lowpass_hz=0)
    assert (slower.hold_steps, slower.lowpass_gain) == (2, 1.0)
