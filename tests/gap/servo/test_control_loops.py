"""Loops of motors that take kp, kd, a position and a velocity, simulated without the judge."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from stiction_envs.gap.servo.questions import Servo
from stiction_envs.gap.servo.servo_diagnosis import ServoDiagnosis, diagnose_servo
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import load_arm

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
PENDULUM = """<mujoco model="pendulum"><worldbody><body name="rod" pos="0 0 1">
<joint name="hinge" axis="0 1 0"/><inertial pos="0 0 -0.15" {inertial}/>
</body></worldbody></mujoco>"""
GRAVITY, INERTIA = 0.741 * 9.81 * 0.15, 0.001 + 0.741 * 0.15**2
KP, KD = 15.3, 0.6
STEP, ENCODER = 1e-3, 2 * np.pi / 4096
KNOWN, UNKNOWN = Servo(stiffness=np.array([KP]), damping=np.array([KD])), Servo()


def _commands(seconds: float) -> Array:
    """Return (T,) angles, 10 ms apart: slow waves, goals with rests, waves of two frequencies."""
    t = np.arange(0.0, seconds, 0.01)
    goals = np.random.default_rng(1).uniform(-0.6, 0.6, 40)
    k = (t / 2.5).astype(int)
    between = np.clip((t / 2.5 - k) / 0.2, 0.0, 1.0)
    steps = goals[k] + (goals[k + 1] - goals[k]) * between**2 * (3 - 2 * between)
    slow = 0.5 * np.sin(2 * np.pi * 0.1 * t)
    fast = 0.6 * slow + 0.15 * np.sin(2 * np.pi * 0.8 * t)
    command = np.choose((3 * t / seconds).astype(int), [slow, steps, fast])
    smooth = np.convolve(np.pad(command, 12, mode="edge"), np.ones(25) / 25, "valid")
    return np.asarray(0.5 + smooth)


def pendulum_log(
    *,
    kp: float = KP,
    kd: float = KD,
    feed_forward: float = 0.0,
    late: int = 0,
    cap: float = np.inf,
    friction: float = 0.0,
    share: float = 0.0,
    rotor: float = 0.0,
    seconds: float = 60.0,
) -> ServoLog:
    """Return a log of the pendulum; its feedback of position is ``late`` ms old."""
    command = _commands(seconds)
    speed = feed_forward * np.gradient(command, 0.01)
    inertia = 1.03 * INERTIA + rotor  # links are off by 3 %
    q, v = np.full(10 * len(command) + late, command[0]), 0.0
    for k in range(late, len(q) - 1):
        row = (k - late) // 10
        torque = kp * (command[row] - q[k - late]) + kd * speed[row]
        torque = min(max(torque, -cap), cap) - (1.0 - share) * 1.03 * GRAVITY * np.sin(q[k])
        free = (v + STEP * torque / inertia) / (1.0 + STEP * kd / inertia)
        most = STEP * friction / inertia / (1.0 + STEP * kd / inertia)
        v = np.sign(free) * max(abs(free) - most, 0.0)
        q[k + 1] = q[k] + STEP * v
    t = np.arange(0.0, 10 * len(command), 10) * STEP
    jitter = 2e-4 * np.random.default_rng(2).uniform(-1.0, 1.0, len(t))
    angle = np.round(q[late::10] / ENCODER) * ENCODER
    return ServoLog(
        source="loop.csv", t=t + jitter, q=angle[:, None], dq=None, q_cmd=command[:, None]
    )


def _diagnosed(
    folder: Path, log: ServoLog, servo: Servo = KNOWN, heavier: float = 1.0
) -> ServoDiagnosis:
    path = folder / "pendulum.xml"
    inertial = f'mass="{0.741 * heavier}" diaginertia="{" ".join(3 * [str(0.001 * heavier)])}"'
    path.write_text(PENDULUM.format(inertial=inertial))
    return diagnose_servo([log], load_arm(path), servo, threads=1)


def _interval(d: ServoDiagnosis, cause: str, key: str) -> tuple[float, float]:
    low, high = next(c for c in d.causes if c.name == cause).parameters[1][key].ci95
    return low, high


def test_the_right_gains_leave_nothing_but_friction(tmp_path: Path) -> None:
    d = _diagnosed(tmp_path, pendulum_log())
    assert d.verdict == "no discrepancy"
    d = _diagnosed(tmp_path, pendulum_log(friction=0.15))
    assert [c.name for c in d.causes] == ["coulomb_friction"]
    low, high = _interval(d, "coulomb_friction", "coulomb_nm")
    assert low < 0.15 < high < 1.3 * low


@pytest.mark.parametrize("heavier", [0.01, 1000.0])
def test_an_arm_of_another_size_has_the_same_causes(tmp_path: Path, heavier: float) -> None:
    """Its motion is the same if its masses, servos and friction all grow alike."""
    log = pendulum_log(friction=0.15)
    one, other = (_diagnosed(tmp_path, log, UNKNOWN, size) for size in (1.0, heavier))
    assert [c.name for c in other.causes] == [c.name for c in one.causes]
    assert {"servo_stiffness", "coulomb_friction", "damping"} == {c.name for c in one.causes}
    for mine, theirs in zip(one.causes, other.causes, strict=True):
        for key, value in mine.parameters[1].items():
            assert theirs.parameters[1][key].value == pytest.approx(heavier * value.value, rel=1e-3)


def test_a_share_of_gravity_is_the_strongest_cause(tmp_path: Path) -> None:
    """Its gain is what the simulation lacks, although links that are off take some of its place."""
    d = _diagnosed(tmp_path, pendulum_log(share=0.6, friction=0.05))
    assert [c.name for c in d.causes] == ["gravity_compensation_missing", "coulomb_friction"]
    assert d.causes[0].gain_percent > 50
    low, high = _interval(d, "gravity_compensation_missing", "share")
    assert low < 0.6 < high < 1.3 * low


def test_gravity_that_is_compensated_sags_no_joint_of_unknown_gains(tmp_path: Path) -> None:
    d = _diagnosed(tmp_path, pendulum_log(share=1.0, friction=0.1), UNKNOWN)
    assert d.extended_rms < 0.15 * d.nominal_rms
    assert {c.name for c in d.causes} >= {"coulomb_friction"}
    assert "servo_stiffness" not in {c.name for c in d.causes}


def test_a_fed_forward_velocity_leads(tmp_path: Path) -> None:
    log = pendulum_log(kd=1.2, feed_forward=1.2, friction=0.15)
    d = _diagnosed(tmp_path, log, Servo(stiffness=np.array([KP]), damping=np.array([1.2])))
    assert d.causes[0].name == "delay"
    assert "servo_stiffness" not in {c.name for c in d.causes}
    lead = d.causes[0].parameters[1]["delay_s"]
    assert -1.2 / KP < lead.value < -0.03
    assert not lead.on_bound
    assert "q_cmd + kd / kp · dq_cmd" in d.causes[0].evidence


def test_a_fed_forward_velocity_in_the_command_leaves_friction_alone(tmp_path: Path) -> None:
    log = pendulum_log(feed_forward=KD, friction=0.15)
    followed = log.q_cmd + KD / KP * np.gradient(log.q_cmd, 0.01, axis=0)
    d = _diagnosed(tmp_path, replace(log, q_cmd=followed))
    assert [c.name for c in d.causes] == ["coulomb_friction"]
    low, high = _interval(d, "coulomb_friction", "coulomb_nm")
    assert low < 0.15 < high < 1.3 * low


def test_a_loop_that_swings_has_no_causes(tmp_path: Path) -> None:
    """A softer servo with a rotor would swing too, but at other times."""
    log = pendulum_log(kp=40.0, kd=0.24, late=20, cap=1.9, rotor=0.3)
    servo = Servo(stiffness=np.array([40.0]), damping=np.array([0.24]))
    d = _diagnosed(tmp_path, log, servo)
    assert np.ptp(log.q[-500:] - log.q_cmd[-500:]) > 0.3
    assert (d.verdict, d.causes) == ("cannot tell", ())
    assert "its control loop is unstable" in d.notes[-1]


def test_a_cap_that_ends_the_swings_is_the_torque_limit(tmp_path: Path) -> None:
    log = pendulum_log(kp=40.0, kd=1.6, late=20, cap=1.9, rotor=0.3)
    servo = Servo(stiffness=np.array([40.0]), damping=np.array([1.6]))
    d = _diagnosed(tmp_path, log, servo)
    assert d.causes[0].name == "torque_limit"
    assert not {"coulomb_friction", "stribeck_friction"} & {c.name for c in d.causes}
