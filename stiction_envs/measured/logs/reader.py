"""Read, check and correct joint logs of real robots; every correction is recorded.

A log is a table ``t,q1..qn,dq1..dqn,tau1..taun`` [s, rad, rad/s, N·m]; dq may be missing,
``temperature1..n`` and ``tau_cmd1..n`` are taken along, a column ``run`` names recordings that
were put into one file. ``tau`` drives the joint: M(q)q̈ + C(q,q̇)q̇ + g(q) = tau − tau_friction.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.logs import (
    check_channels,
    check_finite,
    check_pace,
    check_speeds,
    check_time,
    check_units,
)
from stiction_envs.measured.logs.clock import correct_clock, find_gaps, usual_step
from stiction_envs.measured.logs.corrections import (
    Correction,
    Rows,
    correct_stale,
    drop_repeats,
    fill_missing,
)
from stiction_envs.measured.logs.files import read_raw
from stiction_envs.measured.logs.formats.base import RawLog
from stiction_envs.measured.logs.joint_names import Naming
from stiction_envs.measured.settings import MotionThresholds, measured_settings

if TYPE_CHECKING:
    from stiction_envs.robots.tables import Limits

__all__ = ["Correction", "JointLog", "read_logs", "read_poses"]

LEAST_SECONDS = 1.0
"""Shorter logs are refused [s]; assumed."""
RUN_PAUSE = 1.0
"""Time put between recordings whose clocks start anew [s]; assumed."""
EPOCH = 1e6
"""Times above this are dates, and counted from the first row instead [s]; assumed."""
IGNORED = "columns not used"
"""How the warning of columns that nothing reads begins."""

Array = NDArray[np.float64]
Path = str | os.PathLike[str]


@dataclass(frozen=True, kw_only=True, eq=False)
class JointLog:
    """One measured log after corrections; arrays are float64 and read-only."""

    source: str
    """File name as given."""
    t: Array
    """Time of each row on the robot's clock, strictly rising, (T,), s."""
    q: Array
    """Joint angles, (T, n), rad."""
    dq: Array | None
    """Joint speeds as logged, (T, n), rad/s; None where the log has none."""
    tau: Array
    """Joint torques, (T, n), N·m."""
    extra: dict[str, Array] = field(default_factory=dict)
    """Further channels: ``temperature`` [°C], ``tau_cmd`` [N·m], (T, n) each."""
    breaks: tuple[int, ...] = ()
    """First row of each segment but the first: where a gap or another recording begins."""
    corrections: tuple[Correction, ...] = ()
    """What was corrected."""
    warnings: tuple[str, ...] = ()
    """What was found and not corrected, a sentence each."""
    static: bool = False
    """Whether the rows are poses at rest without order in time; then ``t`` counts them."""
    date: float | None = None
    """Date that was taken off ``t``, s; None where times are no dates."""
    side: str | None = None
    """Side of the gear on which ``tau`` was measured, where the file says it: motor or link."""

    def __post_init__(self) -> None:
        for array in (self.t, self.q, self.dq, self.tau, *self.extra.values()):
            if array is not None:
                array.flags.writeable = False

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    @property
    def step(self) -> float:
        """Usual time between rows, s."""
        return float(np.median(np.diff(self.t)))

    @property
    def segments(self) -> tuple[slice, ...]:
        """Rows of each segment."""
        bounds = (0, *self.breaks, len(self.t))
        return tuple(slice(a, b) for a, b in pairwise(bounds))


def read_logs(
    paths: Sequence[Path],
    n_joints: int,
    *,
    limits: Limits | None = None,
    naming: Naming | None = None,
    motion: MotionThresholds | None = None,
) -> list[JointLog]:
    """Read, check and correct the logs of one robot.

    Args:
        paths: one or more of the files of `formats.registry`: ``.csv`` and ``.csv.gz`` (our
            columns, or those of libfranka and franka_ros), ``.npz`` (columns, or matrices ``q``,
            ``tau``, … with ``t``), ``.parquet``, ROS bags.
        n_joints: joints of the robot.
        limits: its limits; without them fewer wrong units are seen.
        naming: names of its joints, for bags.
        motion: when a joint moves; None for ``[motion]`` of ``settings.toml``.

    Raises:
        StictionError: a file cannot be read, is no log of this robot, or cannot be a measurement.
            The message names file, row and column.
    """
    if not paths:
        raise StictionError("no log given: expected one or more files")
    motion = motion or measured_settings().motion
    logs: list[JointLog] = []
    for path in paths:
        raw = read_raw(path, n_joints, naming=naming)
        log = _corrected(raw, limits, motion)
        for other in logs:
            if np.array_equal(other.q, log.q) and np.array_equal(other.tau, log.tau):
                raise StictionError(f"{log.source}: the same log as {other.source}: expected one")
        logs.append(log)
    return logs


def read_poses(
    path: Path,
    n_joints: int,
    *,
    limits: Limits | None = None,
    naming: Naming | None = None,
) -> JointLog:
    """Read poses at rest without time: ``q1..qn,tau1..taun``, one pose in a row.

    Raises:
        StictionError: as :func:`read_logs`; also for fewer than two poses.
    """
    raw = read_raw(path, n_joints, time=False, naming=naming)
    rows = Rows(t=raw.t, data=raw.data, run=raw.run)
    check_finite(rows, raw.place)
    corrections, warnings = fill_missing(rows, raw.place)
    if len(rows.t) < 2:
        raise StictionError(f"{raw.source}: {len(rows.t)} pose: expected two or more")
    rows.t = np.arange(float(len(rows.t)))
    rows.data.pop("dq", None)
    warnings += check_units(rows, raw.place, limits)
    return _log(raw, rows, corrections, warnings, static=True)


def _log(
    raw: RawLog, rows: Rows, corrections: list[Correction], warnings: list[str], **more: Any
) -> JointLog:
    """Return the log of corrected rows, and what was found before."""
    data = dict(rows.data)
    return JointLog(
        source=raw.source,
        t=rows.t,
        q=data.pop("q"),
        dq=data.pop("dq", None),
        tau=data.pop("tau"),
        extra=data,
        corrections=(*raw.notes, *corrections),
        warnings=(*_ignored(raw), *warnings),
        side=raw.side,
        **more,
    )


def _corrected(raw: RawLog, limits: Limits | None, motion: MotionThresholds) -> JointLog:
    rows = Rows(t=raw.t, data=raw.data, run=raw.run)
    # Arrays live on in rows only, so that those corrected away are freed.
    raw.t, raw.data, raw.run = raw.t[:0], {}, raw.run[:0]
    check_finite(rows, raw.place)
    check_time(rows, raw.place)
    start = float(raw.origin + rows.t[0])
    date = start if abs(start) > EPOCH else None
    corrections = _join_runs(rows, date)
    more, warnings = fill_missing(rows, raw.place)
    corrections += more
    warnings += check_units(rows, raw.place, limits)
    warnings += check_channels(rows, raw.place, motion)
    corrections += drop_repeats(rows) + correct_stale(rows)
    more, jitter = correct_clock(rows)
    corrections, warnings = corrections + more, warnings + jitter
    step = usual_step(rows)
    breaks = _segments(rows, step, corrections)
    bounds = list(pairwise((0, *breaks, len(rows.t))))
    seconds = sum(rows.t[b - 1] - rows.t[a] for a, b in bounds)
    if not seconds >= LEAST_SECONDS - 1.5 * step:
        raise StictionError(
            f"{raw.source}: {seconds:.3g} s of samples: expected {LEAST_SECONDS:g} s or more"
        )
    part = slice(*max(bounds, key=lambda ab: ab[1] - ab[0]))
    data = {k: v[part] for k, v in rows.data.items()}
    longest = Rows(t=rows.t[part], data=data, run=rows.run[part])
    try:
        check_pace(longest, step, limits)
        warnings += check_speeds(longest, step, motion)
    except StictionError as error:
        raise StictionError(f"{raw.source}: {error}") from None
    return _log(raw, rows, corrections, warnings, breaks=breaks, date=date)


def _ignored(raw: RawLog) -> list[str]:
    if not raw.ignored:
        return list(raw.warnings)
    shown = ", ".join(repr(name) for name in raw.ignored[:8])
    more = f" and {len(raw.ignored) - 8} more" if len(raw.ignored) > 8 else ""
    return [*raw.warnings, f"{IGNORED}: {shown}{more}"]


def _join_runs(rows: Rows, date: float | None) -> list[Correction]:
    """One rising time for all recordings of a file, and small numbers for dates."""
    corrections = []
    starts = np.flatnonzero(np.diff(rows.run)) + 1
    if date is not None:
        text = f"times are dates: counted from the first row, {date:.3f} s"
        rows.t = rows.t - rows.t[0]
        corrections.append(Correction(kind="epoch", rows=len(rows.t), text=text))
    restarts = 0
    shifted = rows.t.copy()
    for i in starts:
        if shifted[i] <= shifted[i - 1]:
            shifted[i:] += shifted[i - 1] + RUN_PAUSE - shifted[i]
            restarts += 1
    if restarts:
        rows.t = shifted
        text = (
            f"{len(starts) + 1} recordings in one file, the clock starts anew in {restarts} of "
            f"them: put one after another, {RUN_PAUSE:g} s apart"
        )
        corrections.append(Correction(kind="run", rows=restarts, text=text))
    return corrections


def _segments(rows: Rows, step: float, corrections: list[Correction]) -> tuple[int, ...]:
    runs = np.flatnonzero(np.diff(rows.run)) + 1
    gaps = np.setdiff1d(find_gaps(rows.t, step), runs)
    if len(gaps):
        longest = (rows.t[gaps] - rows.t[gaps - 1]).max()
        text = (
            f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''} of up to {longest:.3g} s: "
            "the log is split there"
        )
        corrections.append(Correction(kind="gap", rows=len(gaps), text=text))
    return tuple(int(i) for i in np.union1d(gaps, runs))
