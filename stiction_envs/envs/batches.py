"""N simulations in batches: as many arms at a time as a core's cache holds.

An arm has some ten kilobytes of engine state. Every control step reads them, and a control interval
has a hundred steps. A thread takes one batch through the whole interval: its state stays in the
core's cache, and no thread waits for another in between. Engine and compiled code release Python's
lock. A thread without a batch helps another with its arms. Results depend neither on the batches
nor on the threads.
"""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.episodes import Episodes, Index, Options, Outcome
from stiction_envs.plant.loop_batch import FEWEST


class Batches:
    """N simulations in several batches; a thread steps one batch at a time.

    Where a batch fails, the others complete their step. Then the error of the first that failed is
    raised; so is an interrupt. Arguments ``ids`` (M,) are numbers of simulations, sorted.
    """

    def __init__(self, make_core: type[Episodes], num_envs: int, **arguments: Any) -> None:
        """Make simulations, ``make_core(M, **arguments)`` for each batch of M."""
        threads = arguments.get("threads") or os.cpu_count() or 1
        count = max(1, -(-num_envs // make_core.arms_per_batch))
        sizes = [num_envs // count + (k < num_envs % count) for k in range(count)]
        if count == 1:
            arguments["engine_threads"] = threads
        self.cores: list[Episodes] = [make_core(n, **arguments) for n in sizes]
        self._end = np.cumsum(sizes)
        shared = make_core.on_one_thread
        most = -(-num_envs // FEWEST) if shared else 1
        self._threads = Threads(min(threads, max(count, most)))
        if shared and threads > 1:
            for core in self.cores[-threads:]:  # other threads have no batch after these
                core.rig.share_out(self._threads.share, threads)

    def _split(self, ids: Index) -> Iterator[tuple[Episodes, Index, slice]]:
        """Yield each batch that has some of ``ids``, their numbers in it, and their slice."""
        start = 0
        for core, end, stop in zip(
            self.cores, self._end, np.searchsorted(ids, self._end), strict=True
        ):
            if stop > start:
                yield core, ids[start:stop] - (end - core.num_envs), slice(start, stop)
            start = stop

    def reset(
        self, ids: Index, rngs: Sequence[np.random.Generator], options: Sequence[Options | None]
    ) -> None:
        """Start an episode in simulations ``ids``; see `Episodes.reset`."""
        batches = list(self._split(ids))
        for core, _, rows in batches:
            core.check_reset(options[rows])  # all, before any is changed
        # one after the other: the others look up what the first batch finds
        drawn = [core.draw(rngs[rows], options[rows]) for core, _, rows in batches]
        pairs = zip(batches, drawn, strict=True)
        self._threads.run([partial(core.begin, mine, new) for (core, mine, _), new in pairs])

    def step(self, ids: Index, action: NDArray[np.floating]) -> Outcome:
        """Dither simulations ``ids`` with ``action`` (M, 2n); see `Episodes.step`."""
        batches = list(self._split(ids))
        for core, mine, rows in batches:
            core.check_step(mine, action[rows])  # all, before any moves
        return _joined(
            self._threads.run([partial(c.step, mine, action[rows]) for c, mine, rows in batches])
        )

    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of simulations ``ids``: a fresh array."""
        return np.concatenate([core.observe(mine) for core, mine, _ in self._split(ids)])

    def last_measures(self, ids: Index) -> dict[str, NDArray[np.generic]]:
        """Measure simulations ``ids``, which are over; see `Episodes.last_measures`."""
        return _rows([core.last_measures(mine) for core, mine, _ in self._split(ids)])

    def describe(self, ids: Index) -> dict[str, NDArray[np.generic]]:
        """Describe the episodes of simulations ``ids``; see `Episodes.describe`."""
        return _rows([core.describe(mine) for core, mine, _ in self._split(ids)])


def _joined(parts: Sequence[Outcome]) -> Outcome:
    if len(parts) == 1:
        return parts[0]
    return Outcome(
        terms=_rows([p.terms for p in parts]),
        terminated=np.concatenate([p.terminated for p in parts]),
        truncated=np.concatenate([p.truncated for p in parts]),
        measures=_rows([p.measures for p in parts]),
    )


def _rows(parts: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Return arrays of all parts by name."""
    return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}


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

        All tasks end first, even if one fails. An interrupt waits for all tasks.
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
