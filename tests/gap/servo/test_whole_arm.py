from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks.servo.blind_servo_logs import robot_file
from stiction_envs.errors import StictionError
from stiction_envs.friction.inertia import link_inertia, mass_and_gravity
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.servo_mjcf import read_servo, servo_mjcf, servo_toml
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.gap.servo.whole_arm import friction_of, simulate_arm
from stiction_envs.measured.logs.robot_log import ServoLog
from stiction_envs.robots import load_arm
from tests.gap.servo.small_arm import parameters, two_links
from tests.servo_arm import LOAD, joint_parameters


def _log(seconds: float = 8.0) -> ServoLog:
    t = np.arange(0.0, seconds, 0.02)
    command = np.stack([0.5 + 0.3 * np.sin(1.3 * t), -0.4 + 0.4 * np.sin(2.1 * t + 1.0)], axis=1)
    return ServoLog(source="plan.csv", t=t, q=command.copy(), dq=None, q_cmd=command)


def _both() -> np.ndarray:
    return joint_parameters(delay=np.array([0.0, 0.015]))


def test_a_joint_alone_moves_as_in_the_whole_arm(tmp_path: Path) -> None:
    arm, log, p = two_links(tmp_path), _log(), _both()
    q = simulate_arm(arm, [log], p, LOAD, threads=1)[0]
    motions = joint_motions(arm, [replace(log, q=q)])
    for j, m in enumerate(motions):
        alone = m.simulate(p[j][None])[0]
        # accelerations of the other joint are known within some 5 Hz only
        assert np.sqrt(np.mean((alone - q[:, j])[50:-50] ** 2)) < 1.5e-3


def test_fine_angles_show_how_fast_motion_couples_the_joints(tmp_path: Path) -> None:
    """Goals that jump: within 5 Hz the accelerations would leave 7 and 14 mrad."""
    arm, p, t = two_links(tmp_path), joint_parameters(), np.arange(0.0, 8.0, 0.01)
    command = np.random.default_rng(2).uniform(-0.4, 0.4, (9, 2))[t.astype(int)]
    log = ServoLog(source="plan.csv", t=t, q=command.copy(), dq=None, q_cmd=command)
    q = simulate_arm(arm, [log], p, LOAD, threads=1)[0]
    for j, m in enumerate(joint_motions(arm, [replace(log, q=q)])):
        alone = m.simulate(p[j][None])[0]
        assert np.sqrt(np.mean((alone - q[:, j])[5:-5] ** 2)) < (3e-3, 7e-3)[j]


def test_same_bits_for_one_log_and_for_several_and_any_threads(tmp_path: Path) -> None:
    arm, log, p = two_links(tmp_path), _log(4.0), _both()
    alone = simulate_arm(arm, [log], p, LOAD, threads=1)[0]
    several = simulate_arm(arm, [_log(6.0), log, log], p, LOAD, threads=2)
    assert np.array_equal(several[1], alone)
    assert np.array_equal(several[2], alone)


def test_model_xml_moves_in_stock_mujoco_as_in_the_plant(tmp_path: Path) -> None:
    arm, log, p = two_links(tmp_path), _log(), joint_parameters()  # MuJoCo's servo has no delay
    text, missing = servo_mjcf(arm, p, LOAD)
    assert missing == ()
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    q = simulate_arm(arm, [log], p, LOAD, threads=1)[0]
    servos = [model.actuator(f"{name}_servo").id for name in arm.joint_names]
    data.qpos[:] = q[0]
    found = []
    for row in log.q_cmd:
        found.append(data.qpos.copy())
        data.ctrl[servos] = row
        for _ in range(20):
            mujoco.mj_step(model, data)
    # it starts with relaxed bristles
    assert np.abs(np.array(found) - q)[100:].max() < 2e-3


def test_what_mujoco_cannot_hold_is_said(tmp_path: Path) -> None:
    p = _both()
    p[0, INDEX["speed_limit"]], p[1, INDEX["dead_zone"]] = 1.5, 0.01
    text, missing = servo_mjcf(two_links(tmp_path), p, np.zeros(2))
    assert any("joint 1" in m and "1.5 rad/s" in m for m in missing)
    assert any("joint 2" in m and "dead zone" in m for m in missing)
    assert all(m in text for m in missing)


def test_servos_read_back_to_the_bit(tmp_path: Path) -> None:
    p = _both()
    p[0, :4] *= 1 + 1e-15
    path = tmp_path / "model.toml"
    path.write_text(servo_toml(p))
    assert np.array_equal(read_servo(path, 2), p)


def _toml(joints: int = 2, **changed: float) -> str:
    p = np.vstack([_both(), _both()])[:joints]
    for name, x in changed.items():
        p[1, INDEX[name]] = x
    return servo_toml(p)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "expected [servo] as a diagnosis"),
        ("[servo]\nstiffness = [1.0, 2.0]", "with stiffness, damping"),
        ("[servo", "not a TOML file"),
        (_toml(joints=3), "[servo] stiffness has shape (3,): expected"),
        (_toml(stiffness=-1.0), "stiffness of joint 2 is -1"),
        (_toml(delay=np.nan), "[servo] delay"),
    ],
)
def test_a_bad_table_of_servos_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "model.toml"
    path.write_text(text)
    with pytest.raises(StictionError) as error:
        read_servo(path, 2)
    assert said in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_bristle_holds_still_where_its_joint_moves_least_inertia() -> None:
    """Joint 2 of an SO-101 moves 0.016 kg·m² at rest, and a tenth where other joints give way."""
    arm = load_arm(robot_file("so101"))
    p = np.stack([parameters(stiction=1.0, stiffness=12.0)] * arm.n)
    friction = friction_of(arm, p, np.zeros(arm.n))
    low, high = arm.limits.position.T
    q = np.random.default_rng(5).uniform(low, high, size=(100, arm.n))
    moved = np.linalg.inv(mass_and_gravity(arm, q)[0] + np.diag(friction.rotor_inertia))
    free = 1.0 / np.diagonal(moved, axis1=1, axis2=2).max(axis=0)
    step = 1e-3
    assert (friction.bristle_stiffness <= 0.12 * free / step**2).all()
    at_rest = friction.rotor_inertia + link_inertia(arm, arm.rest[None])[0]
    damping = friction.bristle_damping_ratio * 2 * np.sqrt(friction.bristle_stiffness * at_rest)
    assert (damping <= 0.6 * free / step).all()
