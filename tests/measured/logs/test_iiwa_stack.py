"""Bags of iiwa_stack: an arm in several topics."""

import numpy as np
import pytest

from stiction_envs.measured.checks.files import check
from stiction_envs.measured.logs.log_files import count_joints
from stiction_envs.measured.logs.reader import drive_of
from tests.measured.logs.bad_logs import VALUES, assert_holds, refuses, servo_log, torque_log
from tests.measured.logs.ros_bags import START, Message, header, joint_states, merged, store

T, Q, DQ, TAU = VALUES[:, 0], VALUES[:, 1:8], VALUES[:, 8:15], VALUES[:, 15:]
AXES = store("ros1").types["iiwa_msgs/msg/JointQuantity"]
POSITION, TORQUE = "/iiwa/state/JointPosition", "/iiwa/state/JointTorque"


def stream(topic: str, values: np.ndarray, *, early: float = 0.0) -> list[Message]:
    """Return messages of one topic, which come ``early`` [s]."""
    quantity = topic.rpartition("/")[2].removeprefix("External")
    field = quantity.removeprefix("Joint").lower()
    return [
        Message(
            topic,
            f"iiwa_msgs/msg/{quantity}",
            START + round(1e9 * (t - early)),
            {"header": header, field: AXES(*(float(np.float32(x)) for x in row))},
        )
        for t, row in zip(T, values, strict=True)
    ]


def arm(name: str = "/iiwa") -> list[Message]:
    channels = {"Position": Q, "Velocity": DQ, "Torque": TAU}
    external = stream(f"{name}/state/ExternalJointTorque", 0 * TAU + 9)
    states = [stream(f"{name}/state/Joint{x}", values) for x, values in channels.items()]
    return merged(*states, external)


def test_topics_become_one_log(bag) -> None:
    path = bag(arm(), kind="bag")
    assert drive_of(path) == "torque"
    assert count_joints(path) == 7
    log = torque_log(path)
    assert_holds(log, VALUES, "t", atol=1e-9)
    assert_holds(log, VALUES, "q dq tau", atol=1e-6)
    assert log.side == "link"
    assert log.date == pytest.approx(START / 1e9)
    text = log.corrections[0].text
    assert "tau is /iiwa/state/JointTorque, measured behind the gear" in text
    assert "External" not in text
    assert not [x for x in check(path).findings if x.kind == "unreadable"]


def test_torques_with_other_stamps_are_interpolated_but_not_over_gaps(bag) -> None:
    torque = stream(TORQUE, TAU, early=0.005)
    del torque[100:120]
    path = bag(stream(POSITION, Q), torque, kind="bag")
    log = torque_log(path)
    # 21 rows have the gap around them, the last no torque after it
    assert len(log.t) == len(T) - 22
    assert log.breaks == (99,)
    middle = 0.5 * (TAU[:-1] + TAU[1:])
    assert log.tau[:99] == pytest.approx(middle[:99], abs=1e-6)
    assert log.tau[99:] == pytest.approx(middle[120:], abs=1e-6)
    assert log.q[99:] == pytest.approx(Q[120:-1], abs=1e-6)


def test_commands_make_a_servo_log(bag) -> None:
    told = stream("/iiwa/command/JointPosition", Q + 0.01, early=0.003)[::2]
    path = bag(stream(POSITION, Q), told, kind="bag")
    assert drive_of(path) == "position"
    log = servo_log(path)
    held = Q[np.arange(len(T)) // 2 * 2] + 0.01
    assert log.q_cmd == pytest.approx(held, abs=1e-6)
    assert log.tau is None
    refuses(lambda: torque_log(path), "no messages of state/JointTorque: expected some beside")


def test_two_arms(bag) -> None:
    path = bag(arm("/left"), arm("/right"), kind="bag")
    refuses(lambda: torque_log(path), "several arms: /left/state/JointPosition, /right")
    assert_holds(torque_log(path, topic="/right/state/JointTorque"), VALUES, "q", atol=1e-6)
    refuses(lambda: torque_log(path, topic="/up"), "/up")


def test_joint_states_beside_them_are_preferred(bag) -> None:
    states = joint_states(VALUES, topic="/iiwa/joint_states")
    path = bag(arm(), states, kind="bag")
    assert "/iiwa/joint_states" in torque_log(path).corrections[0].text
    chosen = torque_log(path, topic=POSITION)
    assert POSITION in chosen.corrections[0].text


def test_what_is_no_such_log(bag) -> None:
    path = bag(arm(), kind="bag")
    refuses(lambda: torque_log(path, 6), "7 joints, but the robot has 6")
    refuses(lambda: servo_log(path), "no messages of command/JointPosition")
    silent = {TORQUE: "iiwa_msgs/msg/JointTorque"}
    path = bag(stream(POSITION, Q), kind="bag", name="silent", silent=silent)
    refuses(lambda: torque_log(path), "no messages of state/JointTorque")
