"""ROS bags as joint logs: what other files of the same numbers give; hostile ones refused."""

import sqlite3
import sys
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stiction_envs.measured.checks.files import check
from stiction_envs.measured.logs.columns import drives_in
from stiction_envs.measured.logs.formats import base
from stiction_envs.measured.logs.log_files import column_names
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import load_arm
from tests.measured.logs.bad_logs import (
    LFS_POINTER,
    VALUES,
    assert_holds,
    good_values,
    put,
    refuses,
    servo_log,
    torque_log,
)
from tests.measured.logs.ros_bags import (
    FINGERS,
    KINDS,
    PANDA,
    START,
    Message,
    header,
    joint_states,
    merged,
    states,
)
from tests.refusal import refusal

ARM = load_arm("panda")
read = partial(torque_log, limits=ARM.limits, robot=ARM.joint_names)
servo = partial(servo_log, limits=ARM.limits, robot=ARM.joint_names)


def assert_same(log: JointLog, *, speeds: bool = True) -> None:
    """The numbers of `VALUES` to the bit, and no corrections but for where they came from."""
    assert_holds(log, VALUES, "t q dq tau" if speeds else "t q tau")
    assert speeds or log.dq is None
    assert log.breaks == ()
    assert {c.kind for c in log.corrections} <= {"source", "epoch"}


def fingers(**how: Any) -> list[Message]:
    """A gripper that publishes to the same topic between the arm's messages."""
    return joint_states(VALUES[:, :7] + [0.002, *[0] * 6], FINGERS, **how)


@pytest.mark.parametrize("kind", KINDS)
def test_joint_states_are_read_to_the_bit(bag, kind: str) -> None:
    """Names decide, not the order in a message; a gripper's messages are left out."""
    log = read(bag(joint_states(VALUES), fingers(), kind=kind))
    assert_same(log)
    assert log.side == "link"
    assert log.date == pytest.approx(START / 1e9, abs=1e-6)
    (source,) = [c.text for c in log.corrections if c.kind == "source"]
    assert "tau is effort, measured behind the gear" in source
    assert "joints 1 to 7 are panda_joint1, panda_joint2" in source
    assert "200 messages of other joints left out" in source


@pytest.mark.parametrize(
    "names",
    [
        tuple(f"lbr_joint_{j}" for j in range(7)),
        tuple(f"robot2_joint_a{j}_rot" for j in range(1, 8)),
    ],
    ids=lambda x: x[0],
)
def test_names_by_number(bag, names: tuple[str, ...]) -> None:
    log = read(bag(joint_states(VALUES, names)))
    assert_same(log)
    assert log.side == ("link" if names[0].startswith("lbr") else None)


def test_names_of_a_ur_need_the_robot_or_the_option(bag) -> None:
    """Names without numbers: by the robot's own, else as the caller says, else one line."""
    names = ("base", "upper", "lower", "wrist_1", "wrist_2", "wrist_3", "tool")
    path = bag(joint_states(VALUES, names))
    assert_same(read(path, robot=names))
    assert_same(read(path, joints=names))
    turned = torque_log(path, joints=names[::-1])
    np.testing.assert_array_equal(turned.tau, VALUES[:, :14:-1])
    refuses(lambda: read(path), r"its joints are base, .*name the joints")
    refuses(lambda: read(path, joints=("hip", *names[1:])), "unknown joint 'hip': expected one of")
    refuses(lambda: read(path, joints=names[:6]), "joints: 6 names: expected 7")


def test_joints_option_is_believed(bag) -> None:
    """Two arms in one bag: the option says which; without it, one line names both."""
    left = tuple(f"left_joint{j}" for j in range(1, 8))
    right = tuple(f"right_joint{j}" for j in range(1, 8))
    both = np.column_stack(
        [VALUES[:, :1], *(VALUES[:, a : a + 7] * s for a in (1, 8, 15) for s in (1, -1))]
    )
    path = bag(joint_states(both, left + right))
    np.testing.assert_array_equal(torque_log(path, joints=right).q, -VALUES[:, 1:8])
    refuses(lambda: read(path), "both left_joint1 to left_joint7 and right_joint1")


def franka_states(tau: str) -> list[Message]:
    def fields(channels: np.ndarray) -> dict[str, Any]:
        q, dq, torque = channels
        return {"header": header, "q": q, "dq": dq, tau: torque, f"{tau}_d": 0 * torque}

    return states(VALUES, "/franka_states", "franka_msgs/msg/FrankaState", fields)


def franka_robot_states() -> list[Message]:
    def state(channels: np.ndarray) -> Any:
        names = [f"fr3_joint{j}" for j in range(1, 8)]
        return lambda known, *_: known.types["sensor_msgs/msg/JointState"](
            header(known, 0), names, *channels
        )

    def fields(channels: np.ndarray) -> dict[str, Any]:
        measured, desired = state(channels), state(0 * channels)
        return {"header": header, "measured_joint_state": measured, "desired_joint_state": desired}

    return states(VALUES, "/broadcaster/state", "franka_msgs/msg/FrankaRobotState", fields)


@pytest.mark.parametrize(
    ("kind", "messages"),
    [
        ("bag", franka_states("tau_J")),
        ("mcap", franka_states("tau_j")),
        ("mcap", franka_robot_states()),
    ],
    ids=["franka_ros", "franka_ros2", "robot_state"],
)
def test_franka_states(bag, kind: str, messages: list[Message]) -> None:
    """tau_J, not the command beside it."""
    log = read(bag(messages, kind=kind))
    assert_same(log)
    assert log.side == "link"


@pytest.mark.parametrize(
    ("package", "torque"), [("lbr_fri_idl", "measured_torque"), ("lbr_fri_msgs", "torque")]
)
def test_lbr_states_have_the_controllers_clock(bag, package: str, torque: str) -> None:
    """States of today's driver and of an old one."""

    def fields(channels: np.ndarray) -> dict[str, Any]:
        q, _, tau = channels
        commanded = {"commanded_torque": 0 * tau} if torque == "measured_torque" else {}
        others = {"sample_time": 0.01, **commanded, "external_torque": 0 * tau}
        return {"measured_joint_position": q, torque: tau, **others}

    messages = states(VALUES, "/lbr/state", f"{package}/msg/LBRState", fields)
    for m, t in zip(messages, VALUES[:, 0], strict=True):
        m.fields["time_stamp_sec"], m.fields["time_stamp_nano_sec"] = divmod(m.time, 10**9)
        # recorded late, by a different time each: the stamps count
        m.time = int(m.time + 1e6 * (1 + np.sin(t)))
    log = read(bag(messages))
    assert_same(log, speeds=False)
    assert log.side == "link"


def test_without_speeds_and_stamps(bag) -> None:
    """No speed is none, and the recorder's time takes the place of a stamp, with a warning."""
    messages = joint_states(VALUES, stamp=lambda known, *_: header(known, 0), speeds=False)
    log = read(bag(messages, kind="bag"))
    assert_same(log, speeds=False)
    assert any("no stamp" in x for x in log.warnings)


def test_several_topics(bag) -> None:
    """Two arms that may be meant: nobody guesses. A gripper's own topic asks nothing."""
    wanted = VALUES.copy()
    wanted[:, 15:] = 1.0
    measured = joint_states(VALUES, topic="/franka/joint_states")
    gripper = fingers(topic="/gripper/joint_states")
    assert_same(read(bag(measured, gripper, name="one")))
    path = bag(measured, joint_states(wanted, topic="/other"), gripper)
    says = r"several topics .*: /franka/joint_states, /other: .*name the topic"
    refuses(lambda: read(path), says)
    assert_same(read(path, topic="/franka/joint_states"))
    refuses(lambda: read(path, topic="/none"), "unknown topic '/none': expected one of /franka")


def test_a_topic_without_messages_asks_nothing(bag) -> None:
    silent = {"/desired": "sensor_msgs/msg/JointState"}
    path = bag(joint_states(VALUES), silent=silent)
    assert_same(read(path))
    refuses(lambda: read(path, topic="/desired"), "/desired: no messages: expected one second")


def test_a_log_of_too_many_numbers(bag, monkeypatch: pytest.MonkeyPatch) -> None:
    """Refused at the message that is too many, so that memory is bounded."""
    monkeypatch.setattr(base, "MOST_VALUES", 50 * 22)
    path = bag(joint_states(VALUES))
    refuses(lambda: read(path), "/joint_states: 51 rows or more: expected at most 1100")


TOLD = VALUES[:, 1:8] + 0.02
LEAD = 2_000_000
"""Commands come this much before the state that follows them [ns]."""


def commands(topic: str, *, stamp: bool) -> list[Message]:
    """Commands of every second row: a `JointState` with stamps, else a `Float64MultiArray`."""
    table = np.column_stack([VALUES[::2, 0], TOLD[::2], np.zeros((100, 14))])
    if stamp:
        out = joint_states(table, topic=topic, speeds=False, efforts=False)
    else:
        out = states(table, topic, "std_msgs/msg/Float64MultiArray", array_fields)
    for m in out:
        m.time -= LEAD
    return out


def array_fields(channels: np.ndarray) -> dict[str, Any]:
    def layout(known: Any, *_: Any) -> Any:
        return known.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)

    return {"layout": layout, "data": channels[0]}


def without_names(messages: list[Message]) -> list[Message]:
    """Return messages in the arm's order that do not name its joints."""
    for m in messages:
        order = [m.fields["name"].index(x) for x in PANDA]
        m.fields |= {k: m.fields[k][order] for k in ("position", "velocity", "effort")}
        m.fields["name"] = []
    return messages


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_messages_without_names_are_in_the_arms_order(bag, kind: str) -> None:
    path = bag(without_names(joint_states(VALUES)), kind=kind)
    log = read(path)
    assert_same(log)
    assert "messages do not name their joints" in log.corrections[0].text
    assert check(path).findings == check(path, robot="panda").findings
    refuses(lambda: torque_log(path, 6), "message 1: 7 joints, but the robot has 6")


@pytest.mark.parametrize(
    ("topic", "stamp"),
    [("/arm/joint_command", True), ("/forward_position_controller/commands", False)],
)
def test_commands_hold_until_the_next(bag, topic: str, stamp: bool) -> None:
    """Under a topic of their own; velocities and efforts are no positions."""
    other = states(
        VALUES, "/effort_controller/commands", "std_msgs/msg/Float64MultiArray", array_fields
    )
    path = bag(joint_states(VALUES), commands(topic, stamp=stamp), other)
    assert drives_in(column_names(path)) == ("torque", "position")
    log = servo(path)
    held = TOLD[np.arange(len(VALUES)) // 2 * 2]
    np.testing.assert_array_equal(log.q_cmd, held)
    assert_holds(log, VALUES, "q tau")
    (text,) = [c.text for c in log.corrections if "commanded positions" in c.text]
    assert text.startswith(f"{topic}: commanded positions, each holds until the next")
    assert ("in the order of joints 1 to 7 (assumed)" in text) == (not stamp)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_the_state_of_a_trajectory_controller(bag, kind: str) -> None:
    """Reference and feedback of one message, joints by name; NaN efforts beside it are none."""

    def point(known: Any, positions: np.ndarray) -> Any:
        zero, types = np.zeros(0), known.types
        span = types["builtin_interfaces/msg/Duration"](0, 0)
        return types["trajectory_msgs/msg/JointTrajectoryPoint"](positions, zero, zero, zero, span)

    def fields(channels: np.ndarray) -> dict[str, Any]:
        q = channels[0][::-1].copy()
        told, measured = ("desired", "actual") if kind == "bag" else ("reference", "feedback")
        parts = {told: q + 0.02, measured: q, "error": q * 0}
        points = {k: lambda known, *_, x=x: point(known, x) for k, x in parts.items()}
        return {"header": header, "joint_names": list(PANDA[::-1]), **points}

    topic, of = "/controller/state", "control_msgs/msg/JointTrajectoryControllerState"
    absent = VALUES.copy()
    absent[:, 8:] = np.nan
    path = bag(states(VALUES, topic, of, fields), joint_states(absent), kind=kind)
    assert drives_in(column_names(path)) == ("position",)
    log = servo(path)
    np.testing.assert_array_equal(log.q_cmd, VALUES[:, 1:8] + 0.02)
    assert_holds(log, VALUES, "q")
    assert log.tau is None
    assert not check(path, robot="panda").defects


def test_several_commands_are_chosen_by_topic(bag) -> None:
    """And a bag without any is one clear line."""
    messages = merged(joint_states(VALUES), commands("/a/cmd", stamp=True))
    path = bag(messages, name="one")
    two = bag(messages, commands("/b/cmd", stamp=False), name="two")
    refuses(lambda: servo(two), "several topics with commanded positions: /a/cmd, /b/cmd: expected")
    np.testing.assert_array_equal(servo(two, topic="/b/cmd").q_cmd, servo(path).q_cmd)
    none = bag(joint_states(VALUES))
    refuses(lambda: servo(none), "no topics with commanded positions: expected one of a JointState")


TWO_PUBLISHERS = merged(
    *(
        joint_states(VALUES[:, np.r_[0, 1 + j, 8 + j, 15 + j]], PANDA[j[0] : j[-1] + 1])
        for j in (np.arange(3), np.arange(3, 7))
    )
)
INFINITE = VALUES.copy()
INFINITE[60, 17] = np.inf
SHORT = joint_states(VALUES)
SHORT[20].fields["effort"] = np.ones(3)
CHAT = [Message("/chat", "std_msgs/msg/String", START + k, {"data": "x"}) for k in range(3)]
BAD_MESSAGES = {
    r"no joint states; its topics are /chat \(std_msgs/msg/String\): expected one of "
    "sensor_msgs/msg/JointState": CHAT,
    "/joint_states, message 1: effort is empty: expected the torques": joint_states(
        VALUES, efforts=False
    ),
    "/joint_states, message 61: tau3 is inf": joint_states(INFINITE),
    "message 21: 3 values of effort: expected 7, one a joint": SHORT,
    "without panda_joint4, .*expected all 7 joints in one message; two publishers": TWO_PUBLISHERS,
    "its joints are panda_joint1, .*expected names that are numbered 1 to 7": joint_states(
        good_values(joints=6), PANDA[:6]
    ),
}


def assert_one_clear_line(path: Path, says: str) -> None:
    message = refuses(lambda: read(path), says)
    assert str(path) in message
    assert len(message.replace(str(path.parent), "")) < 400


@pytest.mark.parametrize("says", BAD_MESSAGES)
def test_bad_messages_are_one_clear_line(bag, says: str) -> None:
    assert_one_clear_line(bag(BAD_MESSAGES[says]), says)


def to_pointer(path: Path) -> None:
    put(path / "log.mcap", LFS_POINTER)


def to_zeros(path: Path) -> None:
    put(path, b"SQLite format 3\0" + b"\0" * 500)


def cut(path: Path) -> None:
    put(path, path.read_bytes()[:20_000])


def undescribe(path: Path) -> None:
    """Make a bag as ROS 2 wrote them before Iron."""
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("DELETE FROM message_definitions")


@pytest.mark.parametrize(
    ("kind", "damage", "says"),
    [
        ("folder", to_pointer, "log.mcap: a pointer of Git LFS .* run `git lfs pull`"),
        ("db3", to_zeros, "damaged or no"),
        ("mcap", cut, "damaged or no ROS bag.*mcap recover"),
        ("db3", undescribe, "does not describe franka_msgs/msg/FrankaState: expected one of sens"),
    ],
)
def test_a_damaged_bag_is_one_clear_line(bag, kind: str, damage, says: str) -> None:
    path = bag(franka_states("tau_j"), kind=kind)
    damage(path)
    assert_one_clear_line(path, says)


def test_without_rosbags(bag, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bag(joint_states(VALUES))
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    refusal(lambda: read(path), r"rosbags: pip install 'stiction-envs\[ros\]'")


def test_names_mean_nothing_to_a_csv(tmp_path: Path) -> None:
    path = put(tmp_path / "log.csv", "t,q1\n0,0\n")
    says = r"^topic: the joints of .*log\.csv have numbers"
    refusal(lambda: read(path, topic="/joint_states"), says)
