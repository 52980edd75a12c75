"""Corrections of all logs: one rising time for all recordings of a file, and segments of it.

Logs of one robot are read one after another, and none of them twice.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.logs import check_finite, check_pace, check_speeds, check_time
from stiction_envs.measured.logs.clock import SLOWEST, correct_clock, find_gaps, usual_step
from stiction_envs.measured.logs.corrections import Correction, RawLog, fill_missing
from stiction_envs.measured.logs.robot_log import RobotLog
from stiction_envs.measured.logs.wrapping import unwrap

if TYPE_CHECKING:
    from stiction_envs.robots.tables import Limits

Path = str | os.PathLike[str]
LogT = TypeVar("LogT", bound=RobotLog)

LEAST_SECONDS = 1.0
"""Shorter logs are refused [s]; assumed."""
RUN_PAUSE = 1.0
"""Time put between recordings whose clocks start anew [s]; assumed."""
EPOCH = 1e6
"""Times above this are dates, and counted from the first row instead [s]; assumed."""
IGNORED = "columns not used"
"""How the warning of columns that nothing reads begins."""


def read_each(given: Sequence[Path | LogT], read: Callable[[Path], LogT]) -> list[LogT]:
    """Return logs in their order: files, each read by ``read``, and logs in memory.

    Raises:
        StictionError: no log, two files with the same numbers, or an error of ``read``.
    """
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


def corrected(
    rows: RawLog,
    limits: Limits | None,
    checks: tuple[Callable[..., list[str]], Callable[[RawLog], list[str]]],
    *,
    correct: Sequence[Callable[[RawLog], list[Correction]]] = (),
    slowest: float = SLOWEST,
) -> tuple[dict[str, Any], dict[str, Array]]:
    """Correct a log: one rising time, no missing values, a regular clock; find its segments.

    Args:
        rows: the log; its arrays are used up.
        limits: of the robot; None where it is not known.
        checks: of units and of channels, of rows without missing values.
        correct: functions that correct values in place, before the clock.
        slowest: as of `correct_clock` [s].

    Returns:
        What all logs have (`RobotLog`), and the other channels.

    Raises:
        StictionError: what cannot be a measurement.
    """
    units, channels = checks
    check_finite(rows)
    check_time(rows)
    start = float(rows.origin + rows.t[0])
    date = start if abs(start) > EPOCH else None
    corrections = [*rows.notes, *_join_runs(rows, date), *unwrap(rows)]
    more, warnings = fill_missing(rows)
    corrections += more
    warnings += units(rows, limits) + channels(rows)
    for change in correct:
        corrections += change(rows)
    corrections += correct_clock(rows, slowest)
    step = usual_step(rows)
    breaks = _segments(rows, step, corrections)
    bounds = list(pairwise((0, *breaks, len(rows.t))))
    seconds = sum(rows.t[b - 1] - rows.t[a] for a, b in bounds)
    if not seconds >= LEAST_SECONDS - 1.5 * step:
        raise StictionError(
            f"{rows.source}: {seconds:.3g} s of samples: expected {LEAST_SECONDS:g} s or more"
        )
    part = slice(*max(bounds, key=lambda ab: ab[1] - ab[0]))
    data = {k: v[part] for k, v in rows.data.items()}
    longest = replace(rows, t=rows.t[part], data=data, run=rows.run[part])
    try:
        late = check_pace(longest, step, limits)
        late += check_speeds(longest, step)
    except StictionError as error:
        raise StictionError(f"{rows.source}: {error}") from None
    others = dict(rows.data)
    common = {
        "source": rows.source,
        "t": rows.t,
        "q": others.pop("q"),
        "dq": others.pop("dq", None),
        "corrections": tuple(corrections),
        "warnings": (*ignored(rows), *warnings, *late),
        "breaks": breaks,
        "held": rows.held,
        "date": date,
    }
    return common, others


def ignored(raw: RawLog) -> list[str]:
    """Return the warnings that its reader has, and one about columns that nothing reads."""
    if not raw.ignored:
        return list(raw.warnings)
    shown = ", ".join(repr(name) for name in raw.ignored[:8])
    more = f" and {len(raw.ignored) - 8} more" if len(raw.ignored) > 8 else ""
    return [*raw.warnings, f"{IGNORED}: {shown}{more}"]


def _join_runs(rows: RawLog, date: float | None) -> list[Correction]:
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


def _segments(rows: RawLog, step: float, corrections: list[Correction]) -> tuple[int, ...]:
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
