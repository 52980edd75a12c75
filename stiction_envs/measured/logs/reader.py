"""Read, check and correct logs of real robots; every correction is recorded.

A joint log is a table ``t,q1..qn,dq1..dqn,tau1..taun`` [s, rad, rad/s, N·m]; dq may be missing,
``temperature1..n`` and ``tau_cmd1..n`` are taken along, a column ``run`` names recordings that
were put into one file. ``tau`` drives the joint: M(q)q̈ + C(q,q̇)q̇ + g(q) = tau − tau_friction.

A servo log is a table ``t,q_cmd1..n,q1..n[,dq1..n][,tau1..n][,current_abs1..n][,run]`` [s, rad,
rad/s, N·m, any unit]. Its rows that repeat the one before are kept: encoders have steps, and
joints that stick rest.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.logs import check_channels, check_finite, check_units
from stiction_envs.measured.checks.servo_logs import check_servo_channels, check_servo_units
from stiction_envs.measured.logs.columns import POSITION, TORQUE
from stiction_envs.measured.logs.corrections import (
    SERVO_CORE,
    Correction,
    correct_stale,
    drop_repeats,
    fill_missing,
    spread_held,
)
from stiction_envs.measured.logs.files import drives, read_raw
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.robot_log import JointLog, RobotLog, ServoLog
from stiction_envs.measured.logs.timing import corrected, ignored, read_each

if TYPE_CHECKING:
    from stiction_envs.robots.tables import Limits

__all__ = [
    "Correction",
    "JointLog",
    "drive_of",
    "read_logs",
    "read_poses",
    "read_servo_logs",
]

Path = str | os.PathLike[str]

SLOWEST_CLOCK = 5e-3
"""Rows of a servo log further apart keep their stamps [s]: a servo that sticks and slips moves too
fast for the slopes over ±25 ms, five rows, that show a clock (`logs.clock`). Source: of 21 logs of
an SO-101 at 50 Hz two seemed to jitter by 2 and 7 ms, their stamps by 0.7 ms."""


def read_logs(
    logs: Sequence[Path | JointLog],
    n_joints: int,
    *,
    limits: Limits | None = None,
    naming: Naming | None = None,
) -> list[JointLog]:
    """Read, check and correct the joint logs of one robot.

    Args:
        logs: one or more files of `formats.registry`, or logs that were read.
        n_joints: joints of the robot.
        limits: its limits; without them fewer wrong units are seen.
        naming: names of its joints, for kinds of files that have them.

    Raises:
        StictionError: a file cannot be read, is no log of this robot, or cannot be a measurement.
            The message names file, row and column.
    """

    def read(path: Path) -> JointLog:
        raw = read_raw(path, n_joints, naming=naming)
        checks, correct = (check_units, check_channels), (drop_repeats, correct_stale, spread_held)
        common, data = corrected(raw, limits, checks, correct=correct)
        return JointLog(**common, tau=data.pop("tau"), extra=data, side=raw.side)

    return read_each(logs, read)


def read_servo_logs(
    logs: Sequence[Path | ServoLog],
    n_joints: int,
    *,
    limits: Limits | None = None,
    naming: Naming | None = None,
) -> list[ServoLog]:
    """Read, check and correct the servo logs of one robot; see `read_logs`."""

    def read(path: Path) -> ServoLog:
        raw = read_raw(path, n_joints, naming=naming, drive=POSITION)
        raw.measured = SERVO_CORE
        checks = check_servo_units, check_servo_channels
        common, data = corrected(raw, limits, checks, slowest=SLOWEST_CLOCK)
        current = data.pop("current_abs", None)
        return ServoLog(
            **common,
            q_cmd=data.pop("q_cmd"),
            tau=data.pop("tau", None),
            current=None if current is None else np.abs(current),
            extra=data,
        )

    return read_each(logs, read)


def read_poses(
    path: Path, n_joints: int, *, limits: Limits | None = None, naming: Naming | None = None
) -> JointLog:
    """Read poses at rest without time: ``q1..qn,tau1..taun``, one pose in a row.

    Raises:
        StictionError: as :func:`read_logs`; also for fewer than two poses.
    """
    raw = read_raw(path, n_joints, time=False, naming=naming)
    check_finite(raw)
    corrections, warnings = fill_missing(raw)
    if len(raw.t) < 2:
        raise StictionError(f"{raw.source}: {len(raw.t)} pose: expected two or more")
    raw.data.pop("dq", None)
    warnings += check_units(raw, limits)
    return JointLog(
        source=raw.source,
        t=np.arange(float(len(raw.t))),
        q=raw.data.pop("q"),
        dq=None,
        tau=raw.data.pop("tau"),
        extra=raw.data,
        corrections=(*raw.notes, *corrections),
        warnings=(*ignored(raw), *warnings),
        side=raw.side,
        static=True,
    )


def drive_of(log: Path | RobotLog, naming: Naming | None = None) -> str:
    """Return what drives the joints of a log: torque, or position where it has no torque.

    Args:
        log: a file of `formats.registry`, or a log in memory.
        naming: names of its joints, for kinds of files that have them.

    Raises:
        StictionError: it has neither torques nor commanded positions, or cannot be read.
    """
    if isinstance(log, RobotLog):
        return log.drive
    found = drives(log, naming)
    if not found:
        raise StictionError(
            f"{os.fspath(log)}: neither torques nor commanded positions: expected t,q1..qn with "
            "tau1..taun or q_cmd1..q_cmdn; columns OURS=NAME renames"
        )
    return TORQUE if TORQUE in found else POSITION
