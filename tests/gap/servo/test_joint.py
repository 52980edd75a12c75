from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import step

from stiction_envs.gap.servo.joint import STEP, command_nodes
from stiction_envs.gap.servo.questions import passed_speed, sag_of
from tests.gap.servo.small_arm import motion, parameters


@pytest.mark.parametrize("damping", [0.4, 2.0])
def test_without_friction_a_step_is_answered_as_by_a_second_order_system(damping: float) -> None:
    """With overshoot, and without."""
    command = np.where(np.arange(200) < 20, 0.0, 0.3)
    got = motion(command, inertia=0.02).simulate(parameters(damping=damping)[None])[0]
    _, answer = step(([20.0], [0.02, damping, 20.0]), T=0.01 * np.arange(180))
    exact = 0.3 * np.concatenate([np.zeros(20), answer])
    fastest = np.abs(np.gradient(exact, 0.01)).max()
    # semi-implicit Euler is off by less than half a step in time
    assert np.abs(got - exact).max() < fastest * STEP / 2


@pytest.mark.parametrize(("compensation", "sag"), [(0.0, 1.0 / 20.0), (1.0, 0.0)])
def test_gravity_sags_a_joint_without_friction_by_its_torque_over_the_stiffness(
    compensation: float, sag: float
) -> None:
    m = motion(np.zeros(400), gravity=1.0)
    got = m.simulate(parameters(damping=1.0, compensation=compensation)[None])[0]
    assert got[-1] == pytest.approx(-sag, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_lag_and_friction_are_no_sag_where_speed_rises_with_gravity(share: float) -> None:
    """A joint that goes one way, faster and faster, as gravity on it grows."""
    command = 0.02 * (0.01 * np.arange(800)) ** 2
    late = {"damping": 1.0, "delay": 0.02, "stiction": 0.3, "compensation": share}
    q = motion(command, slope=2.0).simulate(parameters(**late)[None])[0]
    sag = sag_of(motion(command, q=q, slope=2.0))
    assert 20.0 * sag == pytest.approx(1.0 - share, abs=0.1)


def test_a_joint_holds_below_its_stiction_and_does_not_creep() -> None:
    command = np.where(np.arange(6000) < 10, 0.0, 0.03)  # 0.6 N·m against 0.8
    got = motion(command).simulate(parameters(damping=0.5, stiction=0.8)[None])[0]
    assert np.abs(got).max() < 4e-3  # presliding
    assert abs(got[-1] - got[1000]) < 1e-6  # 50 s


def test_a_joint_goes_above_its_stiction_and_stops_short_by_it() -> None:
    command = np.where(np.arange(600) < 10, 0.0, 0.2)
    got = motion(command).simulate(parameters(damping=2.0, stiction=0.8)[None])[0]
    assert got[-1] == pytest.approx(0.2 - 0.8 / 20.0, abs=1e-3)


def test_a_delay_shifts_the_answer() -> None:
    t = 0.01 * np.arange(600)
    command = 0.3 * np.sin(2 * np.pi * 0.5 * t)
    m = motion(command)
    now, late = m.simulate(np.stack([parameters(damping=0.5), parameters(damping=0.5, delay=0.03)]))
    assert np.abs(late[200:] - np.interp(t - 0.03, t, now)[200:]).max() < 1e-4


def test_the_servo_is_limited_in_torque_and_the_command_in_speed() -> None:
    m = motion(np.where(np.arange(400) < 10, 0.0, 1.0))
    limited = parameters(damping=2.0, torque_limit=1.0), parameters(damping=0.5, speed_limit=0.4)
    weak, slow = m.simulate(np.stack(limited))
    assert np.diff(weak).max() / 0.01 == pytest.approx(1.0 / 2.0, rel=0.01)  # limit / damping
    assert np.diff(slow[60:250]).max() / 0.01 == pytest.approx(0.4, rel=0.01)


def test_inside_its_dead_zone_a_servo_does_nothing() -> None:
    m = motion(np.where(np.arange(400) < 10, 0.0, 0.2))
    zones = [parameters(damping=2.0, dead_zone=x) for x in (0.05, 0.3)]
    got, still = m.simulate(np.stack(zones))
    assert got[-1] == pytest.approx(0.15, abs=1e-4)
    assert np.abs(still).max() == 0.0


def test_an_offset_of_the_encoder_shows_only_through_gravity() -> None:
    command = 0.3 * np.sin(0.05 * np.arange(500))
    both = np.stack([parameters(damping=1.0), parameters(damping=1.0, offset=0.1)])
    without, heavy = (motion(command, slope=x).simulate(both) for x in (0.0, 2.0))
    assert np.abs(without[0] - without[1])[100:].max() < 1e-9
    # measured angles are those commanded here, so gravity is slope times the command
    assert (heavy[0] - heavy[1])[-1] == pytest.approx(-2.0 * 0.1 / 22.0, rel=0.05)


def test_backlash_of_a_slow_servo_is_dry_friction() -> None:
    """Play of a gap stops and starts an angle as friction of stiffness·gap/2 does."""
    step, gap = 0.01, 0.04
    t = step * np.arange(6000)
    command = 0.3 * np.sin(2 * np.pi * t / 30.0)
    rubbed = motion(command, step=step).simulate(
        parameters(stiction=20.0 * gap / 2, damping=0.1)[None]
    )[0]
    played = np.zeros_like(command)
    for k in range(1, len(t)):
        played[k] = np.clip(played[k - 1], command[k] - gap / 2, command[k] + gap / 2)
    assert np.sqrt(np.mean((played - command) ** 2)) > 0.4 * gap
    # the servo lags by damping/stiffness times the speed; at reversals the bristle gives
    lag = 0.1 / 20.0 * 0.3 * 2 * np.pi / 30.0
    assert np.median(np.abs(rubbed - played)) < 2 * lag
    assert np.abs(rubbed - played).max() < 0.1 * gap


def test_a_clock_that_jitters_does_not_make_a_joint_creep() -> None:
    """The bristle is one spring, however long a row lasts."""
    m = motion(np.where(np.arange(6000) < 10, 0.0, 0.02))  # 0.4 N·m against 0.8
    late = 2e-3 * np.random.default_rng(0).uniform(-1.0, 1.0, len(m.t))
    t = m.t + late
    jitters = replace(m, t=t, nodes=command_nodes(t, m.command, t[0] - 1.0, t[-1] + 1.0))
    # heavy friction of a light joint, whose bristle is as stiff as a step allows
    got = jitters.simulate(parameters(damping=0.5, stiction=0.8, bristle=2e-4)[None])[0]
    assert abs(got[-1] - got[1000]) < 1e-6  # 50 s


@pytest.mark.parametrize("stiction", [0.0, 0.4])
def test_the_speed_that_a_motion_shows_is_within_its_limit(stiction: float) -> None:
    """A joint that stands behind its reference and catches up is no faster than that."""
    command = 0.6 * np.sign(np.sin(2 * np.pi * 0.01 * np.arange(3000) / 4.0))
    true = parameters(damping=0.5, stiction=stiction, drop=0.5, speed_limit=0.52)
    m = motion(command)
    shown = passed_speed(replace(m, q=m.simulate(true[None])[0]))
    assert 0.4 < shown <= 0.52 * 1.001
