"""CSV logs of Franka's arms: of libfranka, and of franka_ros (ROS 1).

`franka::logToCSV` writes the states and commands that a `ControlException` brings along;
``rostopic echo -p /franka_state_controller/franka_states`` prints the same states.

| libfranka | franka_ros | becomes |
|---|---|---|
| ``time`` (the robot's clock, whole milliseconds) | ``field.header.stamp`` (nanoseconds) | ``t`` |
| ``state.q[0..6]`` | ``field.q0..6`` | ``q1..q7`` |
| ``state.dq[0..6]`` | ``field.dq0..6`` | ``dq1..dq7`` |
| ``state.tau_J[0..6]`` | ``field.tau_J0..6`` | ``tau1..tau7``: behind the gear, with gravity |
| all others | all others | not read |

``cmd.tau_J_d`` and ``field.tau_J_d`` are the command without gravity, which the robot adds itself,
and so no torque that moved the arm. A log of your own with these names will do; libfranka keeps 50
samples unless the `log_size` of `franka::Robot` says more, and prints six digits unless the
stream's precision does.
Sources: libfranka, src/log.cpp; franka_ros, franka_msgs/msg/FrankaState.msg; the ROS wiki on
rostopic echo -p.
"""

import re
from collections.abc import Callable

from stiction_envs.measured.logs.formats.base import Header

_OURS = {"q": "q", "dq": "dq", "tau_J": "tau"}


def _column(time: str, channel: str) -> Callable[[str], str]:
    """Return the renaming to our columns; `channel` matches a channel and a joint from 0."""
    pattern = re.compile(channel)

    def column(name: str) -> str:
        if name == time:
            return "t"
        match = pattern.fullmatch(name)
        return f"{_OURS[match[1]]}{int(match[2]) + 1}" if match else name

    return column


LIBFRANKA = Header(
    mark="state.q[0]",
    column=_column("time", r"state\.(q|dq|tau_J)\[(\d)\]"),
    per_second=1e3,
    side="link",
    note="a log of libfranka: tau is state.tau_J, measured behind the gear, with gravity",
)

FRANKA_ROS = Header(
    mark="field.tau_J0",
    column=_column("field.header.stamp", r"field\.(q|dq|tau_J)(\d)"),
    per_second=1e9,
    side="link",
    note="states of franka_ros: tau is tau_J, measured behind the gear, with gravity",
)
