"""When logs were recorded: the time since each log began, and since its session began.

Warm-up depends on a clock that files seldom contain. Logs share a clock where all or none of them
have dates, and their times rise from log to log without overlap; logs that all start at zero do
not. A pause that is long enough for a gear to cool down begins another session. Logs with dates
may belong to a session whose first logs were diagnosed before.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.measured.logs.reader import JointLog

COLD_AFTER = 3600.0
"""Pause after which gears are cold again [s]; assumed: three time constants of 20 min."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sessions:
    """One entry per log, in the order of the logs; static ones have no time."""

    start: Array
    """(L,) first row of each log on its own clock [s]."""
    since: Array
    """(L,) time from the start of its session to that of the log [s]; 0 where unknown."""
    common_clock: bool
    """Whether logs with motion share a clock, if there are several."""


Spans = tuple[tuple[float, float], ...]
"""Begin and end of sessions by the logs' dates [s since 1970]."""


def sessions(logs: Sequence[JointLog], earlier: Spans = ()) -> Sessions:
    """Return when each log was recorded, if the clocks show it.

    ``earlier`` are sessions of the same robot, which logs with dates may continue.
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
        first = np.r_[True, pause > COLD_AFTER]
        of_session = np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))
        since[moving[order]] = begin[order] - begin[order][of_session]
    if None not in dated:
        for i, at in zip(moving, begin - since[moving], strict=True):
            since[i] += max((at - s for s, e in earlier if s <= at <= e + COLD_AFTER), default=0.0)
    return Sessions(start=start, since=since, common_clock=common)


def spans(logs: Sequence[JointLog], earlier: Spans = ()) -> Spans:
    """Return the sessions of logs with dates, joined with earlier ones that they continue."""
    dated = [(x.date, x.t) for x in logs if x.date is not None and not x.static]
    of_logs = [(float(date + t[0]), float(date + t[-1])) for date, t in dated]
    out: list[tuple[float, float]] = []
    for begin, end in sorted([*earlier, *of_logs]):
        if out and begin <= out[-1][1] + COLD_AFTER:
            out[-1] = out[-1][0], max(out[-1][1], end)
        else:
            out.append((begin, end))
    return tuple(out)
