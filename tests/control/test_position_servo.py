"""The path of a command to a servo, against closed forms and `diagnose`."""

import numpy as np
import pytest

from stiction_envs.control.position_servo import ServoDrive, put_under_servos
from stiction_envs.friction.servos import read_servos
from stiction_envs.friction.sticking import sticking_model
from stiction_envs.gap.servo.whole_arm import simulate_arm
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.plant import Plant
from tests.refusal import refusal
from tests.servo_arm import LOAD, joint_parameters, servo_arm


def drive_of(folder, **changes):
    arm, path = servo_arm(folder, **changes)
    servos, sticking = read_servos(path, arm.n), sticking_model(arm, path)
    put_under_servos(sticking, servos)
    return ServoDrive(servos, Plant(sticking, 1, threads=1))


@pytest.mark.parametrize(
    "changes", [{}, {"delay": 0.0173}, {"speed_limit": 0.3}, {"dead_zone": 0.01}]
)
def test_it_moves_an_arm_as_the_diagnosis_of_servo_logs_does(tmp_path, changes):
    t = np.arange(0.0, 6.0, 0.02)
    command = np.stack([0.5 + 0.3 * np.sin(1.3 * t), -0.4 + 0.4 * np.sin(2.1 * t)], axis=1)
    log = ServoLog(source="a", t=t, q=command.copy(), dq=None, q_cmd=command)
    drive = drive_of(tmp_path, **changes)
    arm = drive.plant.sticking.arm
    found = simulate_arm(arm, [log], joint_parameters(**changes), LOAD, threads=1)[0]
    ids = np.array([0])
    drive.plant.reset(ids, command[:1])
    drive.reset(ids, command[:1])
    # one block is shorter than the delay
    parts = np.split(np.repeat(command, 20, axis=0), [3000, 3005])
    q = np.concatenate([drive.run(part[None], ids)[0] for part in parts])
    # bristles start relaxed here, loaded there
    np.testing.assert_allclose(q[19::20][75:-1], found[76:], atol=2e-4)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("stiffness = [80.0, 30.0]", "stiffness = [80.0]", r"numbers of shape \(2,\)"),
        ("stiffness = [80.0, 30.0]", "stiffness = [80.0, 0.0]", "above 0"),
        ("delay = [0.0, 0.0]", "delay = [0.0, nan]", "delay"),
        ("delay = [0.0, 0.0]", "delay = [0.0, 5.0]", "numbers to 1"),
        ("delay = [0.0, 0.0]", "", "delay"),
        ("dead_zone = [0.0, 0.0]", "dead_zone = [-1.0, 0.0]", "from 0"),
    ],
)
def test_a_bad_table_of_servos_is_one_line(tmp_path, old, new, said):
    _, path = servo_arm(tmp_path)
    head, table = path.read_text().split("[servo]")
    assert old in table
    path.write_text(f"{head}[servo]{table.replace(old, new)}")
    refusal(lambda: read_servos(path, 2), said)


def test_a_delay_is_that_of_a_clock_where_it_is_negative(tmp_path):
    _, path = servo_arm(tmp_path, delay=-0.01)
    assert read_servos(path, 2).delay.tolist() == [-0.01, -0.01]
