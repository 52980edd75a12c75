"""`diagnose` of servo logs: the known servos, the logs, and the result."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError, checked_array
from stiction_envs.gap.servo.questions import Servo
from stiction_envs.gap.servo.servo_mjcf import read_servo
from stiction_envs.gap.servo.servo_parameters import INDEX, LOW, PARAMETERS
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.reader import read_servo_logs
from stiction_envs.measured.logs.robot_log import JointLog, ServoLog
from stiction_envs.measured.logs.sources import Log
from stiction_envs.robots import Arm

MOVED = 0.1
"""Least range of a joint's angle that shows what its commands are [rad]; assumed."""
LEAVES = 0.1
"""Most that sums of commands leave of the squared distance between commands and angles [-];
assumed."""


def servo_of(
    arm: Arm,
    nominal: object,
    *,
    stiffness: Sequence[float] | None,
    damping: Sequence[float] | None,
    same: bool,
) -> Servo:
    """Return the known servos from the options of `diagnose` with these names.

    Raises:
        StictionError: numbers that cannot be, or another nominal model.
    """
    if nominal in ("rigid", "file"):
        if damping is not None and stiffness is None:
            raise StictionError("servo damping: expected with a servo stiffness")
        return Servo(
            stiffness=_each(stiffness, "stiffness", arm.n),
            damping=_each(damping, "damping", arm.n),
            same=same,
            arm=arm if nominal == "file" else None,
        )
    path = Path(nominal if isinstance(nominal, str | Path) else "parameters")
    if path.suffix != ".toml":
        raise StictionError(
            f"nominal {path}: servo logs expect rigid, file, or the model.toml of an earlier one"
        )
    if stiffness is not None or damping is not None:
        raise StictionError("servo stiffness, damping: expected in the nominal model.toml")
    return Servo(parameters=read_servo(path, arm.n), same=same)


def _each(values: Sequence[float] | None, name: str, n: int) -> Array | None:
    if values is None:
        return None
    unit, low = PARAMETERS[name].unit, LOW[INDEX[name]]
    return checked_array(values, f"servo {name}", (n,), fill=True, low=low, unit=unit)


def read_servo_files(given: Sequence[Log], arm: Arm, naming: Naming) -> list[ServoLog]:
    """Return the logs in their order.

    Raises:
        StictionError: as of `read_servo_logs`; a log of another robot.
    """
    for x in given:
        if isinstance(x, JointLog):
            raise StictionError(f"{x.source}: a log of torques: expected servo logs")
    mine = [x for x in given if isinstance(x, str | Path | ServoLog)]
    logs = read_servo_logs(mine, arm.n, limits=arm.limits, naming=naming) if mine else []
    for log in logs:
        if log.n != arm.n:
            raise StictionError(f"{log.source}: {log.n} joints, but {arm.name} has {arm.n}")
        _refuse_differences(log)
    return logs


def _refuse_differences(log: ServoLog) -> None:
    """Raise a StictionError where the sums of a log's commands, not the commands, are its angles.

    It needs a joint that moves: by `MOVED` at least.
    """
    moved = np.ptp(log.q, axis=0) > MOVED
    summed = log.q[0] + np.cumsum(log.q_cmd, axis=0)
    off, off_sums = (np.mean((x - log.q) ** 2, axis=0)[moved] for x in (log.q_cmd, summed))
    if moved.any() and (off_sums < LEAVES * off).all():
        raise StictionError(
            f"{log.source}: q_cmd are differences of angles from row to row: expected angles; "
            "their sums from the first angle on follow the joints"
        )
