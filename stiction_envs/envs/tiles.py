"""A batch in tiles: as many arms at a time as a core's cache holds; threads own tiles.

An arm has some ten kilobytes of engine state. Every control step reads them, and a control interval
has a hundred steps. A thread takes a tile through the whole interval: its state stays in the core's
cache, and no thread waits for another in between. Engine and compiled code release Python's lock.
A thread without a tile helps another with its arms. Results do not depend on the tiles, nor on the
threads.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.engines.choose import DEFAULT_ENGINE
from stiction_envs.envs.crew import Crew
from stiction_envs.envs.places import Places, PlacesAhead
from stiction_envs.experiments.episodes import Episodes, Index, Options, Outcome
from stiction_envs.plant.loop_batch import FEWEST

ON_DEVICE = 4096
"""Arms of a tile that is stepped on a device of the engine's [-]: 1,024 take 0.34 ms a step there,
4,096 take 0.43 ms, 16,384 take 0.75 ms (``benchmarks/engines/warp``, an H100)."""


class Tiles:
    """N simulations in several tiles; each thread takes one of them at a time.

    Where a tile fails, the others complete what was asked of them. Then the error of the first that
    failed is raised; so is an interrupt. Arguments ``ids`` (M,) are numbers of simulations, sorted.
    """

    def __init__(self, make_core: type[Episodes], num_envs: int, **arguments: Any) -> None:
        """Make the simulations.

        Args:
            make_core: makes a tile of the number of simulations and ``arguments``.
            num_envs: number of simulations N.
            arguments: of the tiles.
        """
        threads = arguments.get("threads") or os.cpu_count() or 1
        count = max(1, -(-num_envs // make_core.arms_per_thread))
        kind: type[Places] = Places
        if arguments.get("engine", DEFAULT_ENGINE) != DEFAULT_ENGINE:
            # such a device takes many arms at once; but what the host does for them waits for it
            count = max(1, min(threads, num_envs // ON_DEVICE))
            kind = PlacesAhead if make_core.others_wait else Places
        sizes = [num_envs // count + (k < num_envs % count) for k in range(count)]
        if count == 1:
            arguments["engine_threads"] = threads
        self.cores: list[Episodes] = [make_core(kind.each * n, **arguments) for n in sizes]
        self._places = [kind(core) for core in self.cores]
        self._end = np.cumsum(sizes)
        parted = make_core.on_one_thread
        most = -(-num_envs // FEWEST) if parted else 1
        self._crew = Crew(min(threads, max(count, most)))
        if parted and threads > 1:
            for core in self.cores[-threads:]:  # other threads have no tile after these
                core.rig.share_out(self._crew.share, threads)

    def _parts(self, ids: Index) -> Iterator[tuple[Places, Index, slice]]:
        """Yield each tile with some of ``ids``, their numbers in it, their places in ``ids``."""
        start = 0
        for tile, end, stop in zip(
            self._places, self._end, np.searchsorted(ids, self._end), strict=True
        ):
            if stop > start:
                yield tile, ids[start:stop] - (end - tile.count), slice(start, stop)
            start = stop

    def reset(
        self,
        ids: Index,
        rngs: Sequence[np.random.Generator],
        options: Sequence[Options | None],
    ) -> None:
        """Start an episode in simulations ``ids``; see `Episodes.reset`."""
        parts = list(self._parts(ids))
        for tile, _, part in parts:
            tile.core.check_reset(options[part])  # all, before any is changed
        # one after the other: what the first tile finds for all, the others look up
        self._crew.run([tile.start(mine, rngs[part], options[part]) for tile, mine, part in parts])

    def step(self, ids: Index, action: NDArray[np.floating]) -> Outcome:
        """Dither simulations ``ids`` with ``action`` (M, 2n); see `Episodes.step`."""
        parts = [(tile.core, tile.of(mine), part) for tile, mine, part in self._parts(ids)]
        for core, mine, part in parts:
            core.check_step(mine, action[part])  # all, before any moves
        return _joined(
            self._crew.run([partial(c.step, mine, action[part]) for c, mine, part in parts])
        )

    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of simulations ``ids``: a fresh array."""
        parts = self._parts(ids)
        return np.concatenate([tile.core.observe(tile.of(mine)) for tile, mine, _ in parts])

    def describe(self, ids: Index) -> dict[str, NDArray[np.generic]]:
        """Describe the episodes of simulations ``ids``; see `Episodes.describe`."""
        parts = [tile.core.describe(tile.of(mine)) for tile, mine, _ in self._parts(ids)]
        return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}

    def locate(self, i: int) -> tuple[int, int]:
        """Return the number of the tile that has simulation ``i``, and its place there."""
        k = int(np.searchsorted(self._end, i, side="right"))
        tile = self._places[k]
        mine = np.array([i - int(self._end[k] - tile.count)])
        return k, int(tile.of(mine)[0])


def _joined(parts: Sequence[Outcome]) -> Outcome:
    if len(parts) == 1:
        return parts[0]

    return Outcome(
        terms={name: np.concatenate([p.terms[name] for p in parts]) for name in parts[0].terms},
        terminated=np.concatenate([p.terminated for p in parts]),
        truncated=np.concatenate([p.truncated for p in parts]),
        measures={k: np.concatenate([p.measures[k] for p in parts]) for k in parts[0].measures},
    )
