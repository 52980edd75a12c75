"""When logs were recorded, as far as their clocks say."""

import numpy as np
import pytest

from stiction_envs.gap.signals.sessions import sessions, spans
from stiction_envs.measured.logs.reader import JointLog

DAY = 86400.0


def log(begin: float, *, date: float | None = None, seconds: float = 20.0, static: bool = False):
    t = begin + np.arange(0.0, seconds, 0.5)
    q = np.zeros((len(t), 2))
    return JointLog(source="x", t=t, q=q, dq=None, tau=q.copy(), date=date, static=static)


KNOWN = ((1.7e9 - 9 * DAY, 1.7e9 - 8 * DAY), (1.7e9, 1.7e9 + 20.0))


@pytest.mark.parametrize(
    ("logs", "known", "since"),
    [
        ([log(0.0), log(60.0)], (), [0, 60]),
        ([log(5000.0), log(5060.0)], (), [0, 60]),
        ([log(60.0), log(0.0)], (), [60, 0]),  # files in any order
        ([log(0.0, static=True), log(100.0), log(160.0)], (), [0, 0, 60]),  # poses have no time
        ([log(0.0, date=1.7e9), log(0.0, date=1.7e9 + 60)], (), [0, 60]),
        ([log(0.0, date=1.7e9), log(0.0, date=1.7e9 + DAY)], (), [0, 0]),
        ([log(x, date=1.7e9) for x in (0.0, 60.0, DAY, DAY + 90.0)], (), [0, 60, 0, 90]),
        # a session that an earlier diagnosis knows goes on
        ([log(0.0, date=1.7e9 + x) for x in (600, 700)], KNOWN, [600, 700]),
        ([log(0.0, date=1.7e9 + x) for x in (600, DAY)], KNOWN, [600, 0]),
    ],
)
def test_clocks_that_rise_say_when(logs, known, since) -> None:
    when = sessions(logs, known)
    assert when.common_clock
    assert when.since.tolist() == pytest.approx(since)


@pytest.mark.parametrize(
    ("logs", "known"),
    [
        ([log(0.0), log(0.0)], ()),
        ([log(0.0), log(10.0)], ()),  # one robot does not move in two logs at once
        ([log(0.0, date=1.7e9), log(60.0)], ()),
        ([log(5000.0)], ()),
        ([log(0.0, date=1.7e9)], KNOWN),  # the log that began it
        ([log(0.0, date=1.7e9 - 600)], KNOWN),  # before it
        ([log(0.0, date=1.7e9 + DAY)], KNOWN),
        ([log(600.0)], KNOWN),  # no date
    ],
)
def test_others_start_cold(logs, known) -> None:
    when = sessions(logs, known)
    assert known or not when.common_clock
    assert not when.since.any()


def test_sessions_grow() -> None:
    first = spans([log(0.0, date=1.7e9), log(0.0), log(0.0, date=1.7e9, static=True)])
    assert first == ((1.7e9, 1.7e9 + 19.5),)
    assert spans([log(0.0, date=1.7e9 + 600)], first) == ((1.7e9, 1.7e9 + 619.5),)
    assert spans([log(0.0, date=1.7e9 + DAY)], first) == (*first, (1.7e9 + DAY, 1.7e9 + DAY + 19.5))
    assert spans([log(0.0)], first) == first
