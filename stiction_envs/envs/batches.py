"""N simulations in batches: as many arms at a time as a core's cache holds.

An arm has some ten kilobytes of engine state. Every control step reads them, and a control interval
has a hundred steps. A thread takes one batch through the whole interval: its state stays in the
core's cache, and no thread waits for another in between. Engine and compiled code release Python's
lock. Results depend neither on the batches nor on the threads.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.episodes import Episodes, Index, Options, Outcome
from stiction_envs.plant.loop_batch import Threads


class Batches:
    """N simulations in several batches; a thread steps one batch at a time.

    Where a batch fails, the others complete their step. Then the error of the first that failed is
    raised; so is an interrupt. Arguments ``ids`` (M,) are numbers of simulations, sorted.
    """

    def __init__(self, make_core: type[Episodes], num_envs: int, **arguments: Any) -> None:
        """Make simulations, ``make_core(M, **arguments)`` for each batch of M."""
        threads = arguments.get("threads") or os.cpu_count() or 1
        count = max(1, -(-num_envs // make_core.arms_per_batch))
        if count == 1:
            arguments["engine_threads"] = threads
        else:  # as many for every thread
            count = min(-(-count // threads) * threads, num_envs)
        sizes = [num_envs // count + (k < num_envs % count) for k in range(count)]
        self.cores: list[Episodes] = [make_core(n, **arguments) for n in sizes]
        self._end = np.cumsum(sizes)
        self._threads = Threads(min(threads, count))

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
        parts = self._threads.run(
            [partial(c.step, mine, action[rows]) for c, mine, rows in batches]
        )
        if len(parts) == 1:
            return parts[0]
        return Outcome(
            terms=_rows([p.terms for p in parts]),
            terminated=np.concatenate([p.terminated for p in parts]),
            truncated=np.concatenate([p.truncated for p in parts]),
            measures=_rows([p.measures for p in parts]),
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


def _rows(parts: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Return arrays of all parts by name."""
    return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
