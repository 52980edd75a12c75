"""A batch in tiles: as many arms at a time as the processor's caches hold.

An arm has some ten kilobytes of engine state. Every control step reads them, and a control interval
has a hundred steps. The state of a tile stays in a core's cache for the whole interval; that of a
larger batch would be loaded again in every step. Results do not depend on the tiles.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.episodes import Episodes, Index, Outcome


class Tiles:
    """N simulations in several tiles, stepped one after the other, each with all threads.

    Arguments ``ids`` (M,) are numbers of simulations, sorted.
    """

    def __init__(self, make_core: type[Episodes], num_envs: int, **arguments: Any) -> None:
        """Make the simulations.

        Args:
            make_core: makes a tile of the number of simulations and ``arguments``.
            num_envs: number of simulations N.
            arguments: of the tiles.
        """
        threads = arguments.get("threads") or os.cpu_count() or 1
        count = max(1, -(-num_envs // (make_core.arms_per_thread * threads)))
        sizes = [num_envs // count + (k < num_envs % count) for k in range(count)]
        self.cores: list[Any] = [make_core(size, **arguments) for size in sizes]
        self._end = np.cumsum(sizes)

    def _parts(self, ids: Index) -> Iterator[tuple[Any, Index, slice]]:
        """Yield each tile with some of ``ids``, their numbers in it, their places in ``ids``."""
        start = 0
        for core, end, stop in zip(
            self.cores, self._end, np.searchsorted(ids, self._end), strict=True
        ):
            if stop > start:
                yield core, ids[start:stop] - (end - core.num_envs), slice(start, stop)
            start = stop

    def reset(
        self,
        ids: Index,
        rngs: Sequence[np.random.Generator],
        options: Sequence[Mapping[str, Any] | None],
    ) -> None:
        """Start an episode in simulations ``ids``; see `Episodes.reset`."""
        for core, _, part in self._parts(ids):
            core.check_reset(options[part])  # all, before any is changed
        for core, mine, part in self._parts(ids):
            core.reset(mine, rngs[part], options[part])

    def step(self, ids: Index, action: NDArray[Any]) -> Outcome:
        """Dither simulations ``ids`` with ``action`` (M, 2n); see `Episodes.step`."""
        for core, mine, part in self._parts(ids):
            core.check_step(mine, action[part])  # all, before any moves
        return _joined([core.step(mine, action[part]) for core, mine, part in self._parts(ids)])

    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of simulations ``ids``: a fresh array."""
        return np.concatenate([core.observe(mine) for core, mine, _ in self._parts(ids)])

    def describe(self, ids: Index) -> dict[str, NDArray[Any]]:
        """Describe the episodes of simulations ``ids``; see `Episodes.describe`."""
        parts = [core.describe(mine) for core, mine, _ in self._parts(ids)]
        return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}

    def locate(self, i: int) -> tuple[int, int]:
        """Return the number of the tile that has simulation ``i``, and its number there."""
        k = int(np.searchsorted(self._end, i, side="right"))
        return k, i - int(self._end[k] - self.cores[k].num_envs)


def _joined(parts: Sequence[Outcome]) -> Outcome:
    if len(parts) == 1:
        return parts[0]

    return Outcome(
        terms={name: np.concatenate([p.terms[name] for p in parts]) for name in parts[0].terms},
        terminated=np.concatenate([p.terminated for p in parts]),
        truncated=np.concatenate([p.truncated for p in parts]),
        measures={k: np.concatenate([p.measures[k] for p in parts]) for k in parts[0].measures},
    )
