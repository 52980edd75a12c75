"""Bags of iiwa_stack (ROS 1): an arm's positions, speeds and torques under topics of their own.

| topic | becomes |
|---|---|
| ``NAME/state/JointPosition`` (``iiwa_msgs/JointPosition``) | ``q``, and the time of the rows |
| ``NAME/state/JointTorque``, ``NAME/state/JointVelocity`` | ``tau`` behind the gear, ``dq`` |
| ``NAME/command/JointPosition`` | ``q_cmd``, which holds until the next one |

Torques and speeds with other stamps are interpolated, but not over a gap.
``ExternalJointTorque`` is what the controller makes of torques and model, and is not read.
Source: IFL-CAMP/iiwa_stack, iiwa_msgs/msg, iiwa_ros/src/state.
"""

from __future__ import annotations

from collections.abc import Mapping

from stiction_envs.errors import StictionError, unknown

_TYPE = "iiwa_msgs/msg/Joint"
_STATE, _COMMAND = "/state/Joint", "/command/Joint"


def arms(types: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return topics by the name of their arm and channel, of all topics with their types."""
    found: dict[str, dict[str, str]] = {}
    for topic, kind in types.items():
        quantity = kind.removeprefix(_TYPE)
        for part, channels in (
            (_STATE, {"Position": "q", "Torque": "tau", "Velocity": "dq"}),
            (_COMMAND, {"Position": "q_cmd"}),
        ):
            name, between, end = topic.partition(part)
            if kind.startswith(_TYPE) and between and end == quantity and quantity in channels:
                found.setdefault(name, {})[channels[quantity]] = topic
    return {name: topics for name, topics in found.items() if "q" in topics}


def arm_of(where: str, found: dict[str, dict[str, str]], topic: str | None) -> dict[str, str]:
    """Return the topics of the only arm, or of that which has a topic."""
    if topic is not None:
        names = {t: name for name, topics in found.items() for t in topics.values()}
        if topic not in names:
            raise StictionError(f"{where}: {unknown('topic', topic, names)}")
        return found[names[topic]]
    if len(found) > 1:
        states = ", ".join(topics["q"] for topics in found.values())
        raise StictionError(
            f"{where}: several arms: {states}: expected one; name a topic of the arm"
        )
    return next(iter(found.values()))
