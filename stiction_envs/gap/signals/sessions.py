"""When logs were recorded: the time since each began, and since the session that it is of.

What warms up runs on a clock that files seldom tell. Logs share one where all of them have dates or
none, and their times rise from log to log without overlap; those that all start at zero do not. A
pause that is long enough for a gear to cool down begins another session.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.settings import SessionSettings
from stiction_envs.measured.logs.reader import JointLog

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sessions:
    """Of the logs, in their order; static ones have no time."""

    start: Array
    """(L,) first row of each log on its own clock [s]."""
    since: Array
    """(L,) time from the start of its session to that of the log [s]; 0 where none is known."""
    common_clock: bool
    """Whether logs with motion, if several, share a clock."""


def sessions(logs: Sequence[JointLog], settings: SessionSettings) -> Sessions:
    """Return when each log was recorded, as far as the clocks say.

    Args:
        logs: one or more.
        settings: when a gear is cold again.
    """
    start, since = np.array([log.t[0] for log in logs]), np.zeros(len(logs))
    moving = np.array([i for i, log in enumerate(logs) if not log.static], dtype=int)
    dated = {logs[i].date is not None for i in moving}
    begin = np.array([(logs[i].date or 0.0) + logs[i].t[0] for i in moving])
    end = np.array([(logs[i].date or 0.0) + logs[i].t[-1] for i in moving])
    order = np.argsort(begin, kind="stable")
    pause = begin[order][1:] - end[order][:-1]
    common = len(moving) > 1 and len(dated) == 1 and bool((pause > 0).all())
    if common:
        first = np.r_[True, pause > settings.cold_after]
        of_session = np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))
        since[moving[order]] = begin[order] - begin[order][of_session]
    return Sessions(start=start, since=since, common_clock=common)
