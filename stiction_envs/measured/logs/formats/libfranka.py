"""What `franka::logToCSV` writes: the states and commands that a `ControlException` brings along.

| column | becomes |
|---|---|
| ``time`` | ``t``; the robot's clock, whole milliseconds |
| ``state.q[0..6]``, ``state.dq[0..6]`` | ``q1..q7``, ``dq1..dq7`` |
| ``state.tau_J[0..6]`` | ``tau1..tau7``: measured behind the gear, with gravity |
| ``state.q_d``, ``state.dq_d``, ``state.tau_ext_hat_filtered``, ``cmd.*`` | not read |

``cmd.tau_J_d`` is the command without gravity, which the robot adds itself, and so no torque that
moved the arm. A log of your own with these names will do; libfranka keeps 50 samples unless the
`log_size` of `franka::Robot` says more, and prints six digits unless the stream's precision does.
Source: libfranka, src/log.cpp.
"""

from __future__ import annotations

import re

from stiction_envs.measured.logs.formats.header import Header

_STATE = re.compile(r"state\.(q|dq|tau_J)\[(\d)\]")
_OURS = {"q": "q", "dq": "dq", "tau_J": "tau"}


def _column(name: str) -> str:
    if name == "time":
        return "t"
    match = _STATE.fullmatch(name)
    return f"{_OURS[match[1]]}{int(match[2]) + 1}" if match else name


LIBFRANKA = Header(
    mark="state.q[0]",
    column=_column,
    per_second=1e3,
    side="link",
    note="a log of libfranka: tau is state.tau_J, measured behind the gear, with gravity",
)
