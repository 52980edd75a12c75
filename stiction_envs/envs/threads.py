"""Threads that share their work: one with nothing left to do helps the others."""

from __future__ import annotations

import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, Generic, TypeVar

T = TypeVar("T")


class Threads:
    """Threads that share work; the thread that calls `run` is the first."""

    def __init__(self, threads: int) -> None:
        """Prepare the threads; all but the caller's start with the first `run`."""
        self._others = threads - 1
        self._pool = ThreadPoolExecutor(max(self._others, 1))
        self._open: list[_Job[Any]] = []
        self._changed = threading.Condition()

    def __reduce__(self) -> tuple[type[Threads], tuple[int]]:
        return Threads, (self._others + 1,)

    def run(self, tasks: Sequence[Callable[[], T]]) -> list[T]:
        """Do tasks on all threads; return their results, or raise the first task's error.

        All tasks are done then, whatever fails. An interrupt waits for them.
        """
        job = _Job(tasks)
        with _interrupts_wait():
            self._offer(job)
            # the caller's thread works too: waking another one takes long
            others = [self._pool.submit(self._help, job) for _ in range(self._others)]
            self._help(job)
            wait(others)
            self._open.remove(job)
        return job.results

    def share(self, tasks: Sequence[Callable[[], T]]) -> list[T]:
        """Do tasks within a task, helped by threads without other work; return their results."""
        job = _Job(tasks)
        self._offer(job)
        while job.work():
            pass
        self._open.remove(job)
        return job.results

    def _offer(self, job: _Job[T]) -> None:
        with self._changed:
            self._open.append(job)
            self._changed.notify_all()

    def _help(self, job: _Job[T]) -> None:
        """Work at ``job``, or at other jobs that are open, until ``job`` is done."""
        while not job.done:
            if any(other.work() for other in tuple(self._open)):
                with self._changed:
                    self._changed.notify_all()
            else:
                with self._changed:
                    self._changed.wait_for(lambda: job.done or any(o.left for o in self._open))


class _Job(Generic[T]):
    """Tasks; any thread takes the next."""

    def __init__(self, tasks: Sequence[Callable[[], T]]) -> None:
        self._futures: list[Future[T]] = [Future() for _ in tasks]
        self.left = deque(zip(self._futures, tasks, strict=True))

    def work(self) -> bool:
        """Do the next task; return whether there was one."""
        try:
            future, task = self.left.popleft()
        except IndexError:
            return False
        try:
            future.set_result(task())
        except BaseException as error:
            future.set_exception(error)
        return True

    @property
    def done(self) -> bool:
        return all(future.done() for future in self._futures)

    @property
    def results(self) -> list[T]:
        """Results of the tasks, when all are done."""
        wait(self._futures)
        return [future.result() for future in self._futures]


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Delay an interrupt until the end, so that no task stops in the middle."""
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is None:
        yield  # Python interrupts the main thread only, and only if it handles the signal
        return
    came: list[int] = []
    usual = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        if came:
            signal.raise_signal(signal.SIGINT)
