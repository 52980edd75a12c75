"""Independent work, pictures for example, shared with a second process."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

T = TypeVar("T")


def shared(jobs: Sequence[Callable[[], T]], threads: int = 0) -> list[T]:
    """Return what each job returns, half of them done by a copy of this process.

    What the copy could not do is done here. Without a second processor, in a program with threads,
    which a copy would lack, and on systems where copies are not safe, all is done here.

    Args:
        jobs: they return what can be pickled, and change nothing that later work needs.
        threads: processors to use, 0 for all.
    """
    if sys.platform != "linux" or threading.active_count() > 1:
        return [job() for job in jobs]
    if min(threads or 2, len(os.sched_getaffinity(0)), len(jobs)) < 2:
        return [job() for job in jobs]
    context = get_context("fork")  # the copy has all data already
    receiver, sender = context.Pipe(duplex=False)
    copy = context.Process(target=_do, args=(jobs[1::2], sender), daemon=True)
    with warnings.catch_warnings():
        # threads of the engine and of linear algebra rest, and the copy needs none of them
        warnings.simplefilter("ignore", DeprecationWarning)
        copy.start()
    sender.close()  # so that the end of the copy is the end of the pipe
    try:
        out: list[Any] = [None] * len(jobs)
        out[::2] = [job() for job in jobs[::2]]
        try:
            out[1::2] = receiver.recv()
        except EOFError:
            out[1::2] = [job() for job in jobs[1::2]]
        return out
    finally:
        receiver.close()
        copy.terminate()
        copy.join()


def _do(jobs: Sequence[Callable[[], object]], sender: Connection) -> None:
    """Do jobs and send what they return; nothing if one fails."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the first process is interrupted, and ends this
    try:
        sender.send([job() for job in jobs])
    except Exception:  # the first process does it again, and says what is wrong
        sender.close()
