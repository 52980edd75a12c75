"""What ``rostopic echo -p /franka_state_controller/franka_states`` prints (franka_ros, ROS 1).

| column | becomes |
|---|---|
| ``field.header.stamp`` | ``t``, nanoseconds |
| ``field.q0..6``, ``field.dq0..6`` | ``q1..q7``, ``dq1..dq7`` |
| ``field.tau_J0..6`` | ``tau1..tau7``: measured behind the gear, with gravity |
| all others, ``field.tau_J_d`` (command without gravity) among them | not read |

Source: franka_ros, franka_msgs/msg/FrankaState.msg; the ROS wiki on rostopic echo -p.
"""

from __future__ import annotations

import re

from stiction_envs.measured.logs.formats.header import Header

_FIELD = re.compile(r"field\.(q|dq|tau_J)(\d)")
_OURS = {"q": "q", "dq": "dq", "tau_J": "tau"}


def _column(name: str) -> str:
    if name == "field.header.stamp":
        return "t"
    match = _FIELD.fullmatch(name)
    return f"{_OURS[match[1]]}{int(match[2]) + 1}" if match else name


FRANKA_ROS = Header(
    mark="field.tau_J0",
    column=_column,
    per_second=1e9,
    side="link",
    note="states of franka_ros: tau is tau_J, measured behind the gear, with gravity",
)
