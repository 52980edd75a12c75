"""CSV that PlotJuggler exports: a column for each curve, ``__time`` [s] beside them.

| curve | becomes |
|---|---|
| ``TOPIC/JOINT/position``, ``velocity``, ``effort`` of a ``JointState`` | ``q``, ``dq``, ``tau`` |
| the same of a topic named command, cmd, target, goal, reference or desired | ``q_cmd`` |
| ``TOPIC/reference/positions[0]`` … (``desired``) of a trajectory controller | ``q_cmd`` |
| ``TOPIC/feedback/positions[0]`` … (``actual``), where no ``JointState`` is there | ``q`` |

A row has the curves that changed at its time; commands hold until the next one. A controller's
joints are in its own order, which is that of its parameter ``joints``.
Source: PlotJuggler, its parser of ``JointState`` and its CSV exporter; control_msgs,
JointTrajectoryControllerState.msg.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array, Bools
from stiction_envs.errors import StictionError, unknown
from stiction_envs.measured.logs.formats.base import Header
from stiction_envs.measured.logs.formats.messages import COMMANDS
from stiction_envs.measured.logs.joint_names import Naming, find_joints

TIME = "__time"
_STATE = re.compile(r"(?P<topic>.+)/(?P<joint>[^/]+)/(?P<field>position|velocity|effort)")
_CONTROLLER = re.compile(
    r"(?P<topic>.+)/(?P<side>reference|desired|feedback|actual)/positions[\[.](?P<number>\d+)\]?"
)
_CHANNELS = {"position": "q", "velocity": "dq", "effort": "tau"}
_Curves = dict[str, dict[str, dict[str, str]]]
"""Columns by topic, joint and channel."""


@dataclass(frozen=True, kw_only=True)
class PlotJuggler(Header):
    """Columns of PlotJuggler, which name topics and joints."""

    has_names: bool = True
    sparse: bool = True

    def ours(
        self, names: Sequence[str], where: str, naming: Naming, n_joints: int | None = None
    ) -> list[str]:
        states, commands = _curves([n.strip() for n in names])
        found = {TIME: "t"}
        topic = _topic(states, where, naming, n_joints)
        if topic is not None:
            motors = [j for j, channels in states[topic].items() if "q" in channels]
            try:
                joints = find_joints(where, motors, n_joints, naming)
            except StictionError:
                if n_joints is not None or naming.joints:
                    raise
                joints = tuple(motors)  # without a robot they are only counted
            for number, joint in enumerate(joints, 1):
                found |= {
                    name: f"{channel}{number}" for channel, name in states[topic][joint].items()
                }
            found |= _commands(commands, joints)
        return [found.get(name.strip(), name.strip()) for name in names]


def _curves(names: Sequence[str]) -> tuple[_Curves, _Curves]:
    """Return the columns of measured and of commanded joints."""
    states: _Curves = {}
    commands: _Curves = {}
    for name in names:
        if match := _STATE.fullmatch(name):
            side = commands if COMMANDS.search(match["topic"]) else states
            channel = _CHANNELS[match["field"]]
            side.setdefault(match["topic"], {}).setdefault(match["joint"], {})[channel] = name
        elif match := _CONTROLLER.fullmatch(name):
            side = commands if match["side"] in ("reference", "desired") else states
            joint = f"joint{int(match['number']) + 1}"
            side.setdefault(match["topic"], {}).setdefault(joint, {})["q"] = name
    return states, commands


def _topic(states: _Curves, where: str, naming: Naming, n_joints: int | None) -> str | None:
    """Return the topic with the arm's states, named joints first; None where there is none."""
    asked = naming.topic
    if asked is not None:
        if asked not in states:
            raise StictionError(f"{where}: {unknown('topic', asked, states)}")
        return asked
    least = n_joints or max((len(x) for x in states.values()), default=0)
    full = {k: v for k, v in states.items() if len(v) >= least}
    # a controller's feedback repeats the joint states, under numbers
    named = [k for k, v in full.items() if not all(re.fullmatch(r"joint\d+", x) for x in v)]
    topics = named or list(full)
    if len(topics) > 1:
        raise StictionError(
            f"{where}: several topics with joint states: {', '.join(topics)}: "
            "expected one; name the topic"
        )
    return topics[0] if topics else None


def _commands(commands: _Curves, joints: tuple[str, ...]) -> dict[str, str]:
    """Return our names of commands: those of the same joints, else of as many by number."""
    numbers = tuple(f"joint{k + 1}" for k in range(len(joints)))
    for wanted in (joints, numbers):
        for topic in commands.values():
            if all("q" in topic.get(x, {}) for x in wanted):
                return {topic[x]["q"]: f"q_cmd{k}" for k, x in enumerate(wanted, 1)}
    return {}


def measured_rows(data: dict[str, Array]) -> Bools:
    """Hold commands (T, n), NaN between them, until the next, in place; return rows with angles."""
    keep: Bools = np.asarray((~np.isnan(data["q"])).any(axis=1))
    if "q_cmd" in data:
        index = np.arange(len(data["q"]))
        for x in data["q_cmd"].T:
            last = np.maximum.accumulate(np.where(np.isnan(x), -1, index))
            x[:] = np.where(last < 0, np.nan, x[last])
        keep &= ~np.isnan(data["q_cmd"]).any(axis=1)
    return keep


PLOTJUGGLER = PlotJuggler(
    mark=TIME,
    column=str,
    per_second=1.0,
    side=None,
    note="CSV of PlotJuggler: curves by their topics and joints",
)
