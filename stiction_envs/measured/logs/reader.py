"""Read, check and correct logs of real robots; every correction is recorded.

A joint log is a table ``t,q1..qn,dq1..dqn,tau1..taun`` [s, rad, rad/s, N·m]; dq may be missing,
``temperature1..n`` and ``tau_cmd1..n`` are taken along, a column ``run`` names recordings that
were put into one file. ``tau`` drives the joint: M(q)q̈ + C(q,q̇)q̇ + g(q) = tau − tau_friction.

A servo log is a table ``t,q_cmd1..n,q1..n[,dq1..n][,tau1..n][,current_abs1..n][,run]`` [s, rad,
rad/s, N·m, any unit]. Its rows that repeat the one before are kept: encoders have steps, and
joints that stick rest.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.measured.checks import logs as checks
from stiction_envs.measured.checks.servo_logs import check_servo_channels, check_servo_units
from stiction_envs.measured.logs.clock import correct_clock, find_gaps, usual_step
from stiction_envs.measured.logs.columns import POSITION, TORQUE, Wanted, drives_in
from stiction_envs.measured.logs.corrections import (
    SERVO_CORE,
    Correction,
    RawLog,
    correct_stale,
    drop_repeats,
    fill_missing,
    spread_held,
    unwrap,
)
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.logs.log_files import column_names, read_raw
from stiction_envs.measured.logs.robot_log import JointLog, RobotLog, ServoLog
from stiction_envs.robots.arm_toml import Limits

__all__ = ["Correction", "JointLog", "drive_of", "read_logs", "read_poses", "read_servo_logs"]

Path = str | os.PathLike[str]
LogT = TypeVar("LogT", bound=RobotLog)

LEAST_SECONDS = 1.0  # shorter logs are refused [s]; assumed
RUN_PAUSE = 1.0  # time put between recordings whose clocks start anew [s]; assumed
EPOCH = 1e6  # times above this are dates, and counted from the first row instead [s]; assumed
IGNORED = "columns not used"
"""How the warning of columns that nothing reads begins."""
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
    """Read, check and correct the joint logs of one robot: files, or logs that were read.

    Without ``limits`` of the robot fewer wrong units are seen; ``naming`` is for files with names.

    Raises:
        StictionError: a file cannot be read, is no log of this robot, or cannot be a measurement.
            The message names file, row and column.
    """

    def read(path: Path) -> JointLog:
        raw = read_raw(path, Wanted(n_joints=n_joints, naming=naming or Naming()))
        common, data = _corrected(raw, limits, TORQUE)
        return JointLog(**common, tau=data.pop("tau"), extra=data, side=raw.side)

    return _read_each(logs, read)


def read_servo_logs(
    logs: Sequence[Path | ServoLog],
    n_joints: int,
    *,
    limits: Limits | None = None,
    naming: Naming | None = None,
) -> list[ServoLog]:
    """Read, check and correct the servo logs of one robot; see `read_logs`."""

    def read(path: Path) -> ServoLog:
        wanted = Wanted(n_joints=n_joints, naming=naming or Naming(), drive=POSITION)
        raw = read_raw(path, wanted)
        raw.measured = SERVO_CORE
        common, data = _corrected(raw, limits, POSITION)
        current = data.pop("current_abs", None)
        return ServoLog(
            **common,
            q_cmd=data.pop("q_cmd"),
            tau=data.pop("tau", None),
            current=None if current is None else np.abs(current),
            extra=data,
        )

    return _read_each(logs, read)


def read_poses(
    path: Path, n_joints: int, *, limits: Limits | None = None, naming: Naming | None = None
) -> JointLog:
    """Read poses at rest without time: ``q1..qn,tau1..taun``, one pose in a row.

    Raises:
        StictionError: as :func:`read_logs`; also for fewer than two poses.
    """
    raw = read_raw(path, Wanted(n_joints=n_joints, time=False, naming=naming or Naming()))
    checks.check_finite(raw)
    corrections, warnings = fill_missing(raw)
    if len(raw.t) < 2:
        raise StictionError(f"{raw.source}: {len(raw.t)} pose: expected two or more")
    raw.data.pop("dq", None)
    warnings += checks.check_units(raw, limits)
    return JointLog(
        source=raw.source,
        t=np.arange(float(len(raw.t))),
        q=raw.data.pop("q"),
        dq=None,
        tau=raw.data.pop("tau"),
        extra=raw.data,
        corrections=(*raw.notes, *corrections),
        warnings=(*_ignored(raw), *warnings),
        side=raw.side,
        static=True,
    )


def drive_of(log: Path | RobotLog, naming: Naming | None = None) -> str:
    """Return the drive of a log's joints: torque, or position if the log has no torque.

    Raises:
        StictionError: it has neither torques nor commanded positions, or cannot be read.
    """
    if isinstance(log, RobotLog):
        return log.drive
    found = drives_in(column_names(log, naming))
    if not found:
        raise StictionError(
            f"{os.fspath(log)}: neither torques nor commanded positions: expected t,q1..qn with "
            "tau1..taun or q_cmd1..q_cmdn; columns OURS=NAME renames"
        )
    return TORQUE if TORQUE in found else POSITION


def _read_each(given: Sequence[Path | LogT], read: Callable[[Path], LogT]) -> list[LogT]:
    """Return logs in their order: files, each read by ``read``, and logs in memory."""
    if not given:
        raise StictionError("no log given: expected one or more files")
    logs: list[LogT] = []
    from_files: list[LogT] = []
    for x in given:
        if isinstance(x, RobotLog):
            logs.append(x)
            continue
        log = read(x)
        for other in from_files:
            # but for their times
            pairs = zip(other.arrays[1:], log.arrays[1:], strict=True)
            if all(a is b or np.array_equal(np.array(a), np.array(b)) for a, b in pairs):
                raise StictionError(f"{log.source}: the same log as {other.source}: expected one")
        logs.append(log)
        from_files.append(log)
    return logs


def _corrected(
    rows: RawLog, limits: Limits | None, drive: str
) -> tuple[dict[str, Any], dict[str, Array]]:
    """Check and correct a log; return the fields of `RobotLog`, and the other channels.

    The log gets one rising time, no missing values, a regular clock and segments.
    """
    checks.check_finite(rows)
    checks.check_time(rows)
    start = float(rows.origin + rows.t[0])
    date = start if abs(start) > EPOCH else None
    corrections = [*rows.notes, *_join_runs(rows, date), *unwrap(rows)]
    more, warnings = fill_missing(rows)
    corrections += more
    if drive == POSITION:
        warnings += check_servo_units(rows, limits) + check_servo_channels(rows)
        corrections += correct_clock(rows, SLOWEST_CLOCK)
    else:
        warnings += checks.check_units(rows, limits) + checks.check_channels(rows)
        corrections += drop_repeats(rows) + correct_stale(rows) + spread_held(rows)
        corrections += correct_clock(rows)
    step = usual_step(rows)
    runs = np.flatnonzero(np.diff(rows.run)) + 1
    gaps = np.setdiff1d(find_gaps(rows.t, step), runs)
    if len(gaps):
        longest = (rows.t[gaps] - rows.t[gaps - 1]).max()
        text = f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''} of up to {longest:.3g} s: "
        text += "the log is split there"
        corrections.append(Correction(kind="gap", rows=len(gaps), text=text))
    breaks = tuple(int(i) for i in np.union1d(gaps, runs))
    bounds = list(pairwise((0, *breaks, len(rows.t))))
    seconds = sum(rows.t[b - 1] - rows.t[a] for a, b in bounds)
    if not seconds >= LEAST_SECONDS - 1.5 * step:
        raise StictionError(
            f"{rows.source}: {seconds:.3g} s of samples: expected {LEAST_SECONDS:g} s or more"
        )
    part = slice(*max(bounds, key=lambda ab: ab[1] - ab[0]))
    data = {k: v[part] for k, v in rows.data.items()}
    whole = replace(rows, t=rows.t[part], data=data, run=rows.run[part])
    try:
        late = checks.check_pace(whole, step, limits) + checks.check_speeds(whole, step)
    except StictionError as error:
        raise StictionError(f"{rows.source}: {error}") from None
    others = dict(rows.data)
    common = {
        "source": rows.source,
        "t": rows.t,
        "q": others.pop("q"),
        "dq": others.pop("dq", None),
        "corrections": tuple(corrections),
        "warnings": (*_ignored(rows), *warnings, *late),
        "breaks": breaks,
        "held": rows.held,
        "date": date,
    }
    return common, others


def _ignored(raw: RawLog) -> list[str]:
    """Return the warnings that its reader has, and one about columns that nothing reads."""
    if not raw.ignored:
        return list(raw.warnings)
    shown = ", ".join(repr(name) for name in raw.ignored[:8])
    more = f" and {len(raw.ignored) - 8} more" if len(raw.ignored) > 8 else ""
    return [*raw.warnings, f"{IGNORED}: {shown}{more}"]


def _join_runs(rows: RawLog, date: float | None) -> list[Correction]:
    """Make one rising time for all recordings of a file; subtract the date."""
    corrections = []
    starts = np.flatnonzero(np.diff(rows.run)) + 1
    if date is not None:
        text = f"times are dates: counted from the first row, {date:.3f} s"
        rows.t = rows.t - rows.t[0]
        corrections.append(Correction(kind="epoch", rows=len(rows.t), text=text))
    restarts = 0
    rows.t = rows.t.copy()
    for i in starts:
        if rows.t[i] <= rows.t[i - 1]:
            rows.t[i:] += rows.t[i - 1] + RUN_PAUSE - rows.t[i]
            restarts += 1
    if restarts:
        text = (
            f"{len(starts) + 1} recordings in one file, the clock starts anew in {restarts} of "
            f"them: put one after another, {RUN_PAUSE:g} s apart"
        )
        corrections.append(Correction(kind="run", rows=restarts, text=text))
    return corrections
