"""A batch walked in tiles: as many arms at a time as the processor's caches hold.

Every arm of a batch costs some ten kilobytes of engine state in every control step, and a control
interval has a hundred of them. Arms that do not fit a core's cache are fetched anew in each; a tile
of them stays where it is for the whole interval, and so do the arrays of its approach. A result
does not depend on the tile: in a core, no arm knows how many there are.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.episodes import Episodes, Index, Outcome


class Tiles:
    """N simulations as several cores, stepped one after the other, each with all threads.

    Wherever simulations ``ids`` (M,) are asked for, they are sorted.
    """

    def __init__(self, make_core: type[Episodes], num_envs: int, **arguments: Any) -> None:
        """Make the simulations.

        Args:
            make_core: called with the number of simulations of a tile and ``arguments``.
            num_envs: number of simulations N.
            arguments: of the core.
        """
        threads = arguments.get("threads") or os.cpu_count() or 1
        count = max(1, -(-num_envs // (make_core.arms_per_thread * threads)))
        sizes = [num_envs // count + (k < num_envs % count) for k in range(count)]
        self.cores: list[Any] = [make_core(size, **arguments) for size in sizes]
        self._end = np.cumsum(sizes)

    def _parts(self, ids: Index) -> Iterator[tuple[Any, Index, slice]]:
        """Yield each core that has some of the sorted ``ids``, its own of them, and where."""
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
            core.check_reset(options[part])  # of all before any changes
        for core, mine, part in self._parts(ids):
            core.reset(mine, rngs[part], options[part])

    def step(self, ids: Index, action: NDArray[Any]) -> Outcome:
        """Dither simulations ``ids`` with ``action`` (M, 2n); see `Episodes.step`."""
        for core, mine, part in self._parts(ids):
            core.check_step(mine, action[part])  # of all before any moves
        return _joined([core.step(mine, action[part]) for core, mine, part in self._parts(ids)])

    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of simulations ``ids``: a fresh array."""
        return np.concatenate([core.observe(mine) for core, mine, _ in self._parts(ids)])

    def describe(self, ids: Index) -> dict[str, NDArray[Any]]:
        """Return what the episodes of simulations ``ids`` are; see `Episodes.describe`."""
        parts = [core.describe(mine) for core, mine, _ in self._parts(ids)]
        return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}

    def locate(self, i: int) -> tuple[int, int]:
        """Return the number of the core that has simulation ``i``, and its number there."""
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
