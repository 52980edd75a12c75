"""Where the simulations of a tile are in its core, and how their episodes start.

    Places         one each: a start is simulated when it is asked for
    PlacesAhead    two each, 2i and 2i + 1: in one an episode runs, in the other the next one waits

A device steps all arms of its batch at once: to bring one to its start takes as long as to bring
all. With two places, all starts that are missing are made together, about once an episode.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from itertools import chain
from typing import Any

import numpy as np

from stiction_envs.experiments.episodes import Drawn, Episodes, Index, Options

State = Any  # of a generator's bits
Rngs = Sequence[np.random.Generator]
AllOptions = Sequence[Options | None]


class Places:
    """Simulations that are where the core has them."""

    each = 1
    """Places of the core that a simulation has."""

    def __init__(self, core: Episodes) -> None:
        """Take all places of a core."""
        self.core = core
        self.count = core.num_envs // self.each
        """Simulations."""

    def of(self, ids: Index) -> Index:
        """Return where simulations ``ids`` (M,), sorted, are in the core, sorted."""
        return ids

    def start(self, ids: Index, rngs: Rngs, options: AllOptions) -> Callable[[], None]:
        """Draw the next episodes of simulations ``ids``; return what begins them."""
        drawn = self.core.draw(rngs, options)
        return lambda: self.core.begin(ids, drawn)


class PlacesAhead(Places):
    """Simulations whose next episodes wait beside the present ones.

    Episodes are those of `Places`: only what a generator will draw next waits, without options, and
    if it has drawn meanwhile or is another one, a start is made anew. A generator moves on when its
    episode starts.
    """

    each = 2

    def __init__(self, core: Episodes) -> None:
        """Take all places of a core."""
        super().__init__(core)
        self._side = np.zeros(self.count, dtype=np.int64)
        self._rngs: dict[int, np.random.Generator] = {}
        """Of the simulations whose last start had no options."""
        self._waiting: dict[int, tuple[State, State]] = {}
        """State of the generator before and after it drew the start that waits."""

    def of(self, ids: Index) -> Index:
        """Return where simulations ``ids`` (M,), sorted, are in the core, sorted."""
        return 2 * ids + self._side[ids]

    def start(self, ids: Index, rngs: Rngs, options: AllOptions) -> Callable[[], None]:
        """Draw the next episodes of simulations ``ids``; return what begins them."""
        late = []
        for row, (i, rng, o) in enumerate(zip(ids.tolist(), rngs, options, strict=True)):
            before, after = self._waiting.pop(i, (None, None))
            if not o and self._rngs.get(i) is rng and before == rng.bit_generator.state:
                rng.bit_generator.state = after
                self._side[i] ^= 1
            else:
                late.append(row)
            self._rngs.pop(i, None)
            if not o:
                self._rngs[i] = rng
        if not late:
            return lambda: None
        now = self.core.draw([rngs[row] for row in late], [options[row] for row in late])
        ahead = np.array(sorted(self._rngs.keys() - self._waiting.keys()), dtype=np.int64)
        copies = [deepcopy(self._rngs[i]) for i in ahead]
        states = [rng.bit_generator.state for rng in copies]
        drawn = [now, self.core.draw(copies, [None] * len(ahead))] if len(ahead) else [now]
        places = np.concatenate([self.of(ids[late]), self.of(ahead) ^ 1])

        def begin() -> None:
            order = np.argsort(places)
            self.core.begin(places[order], _merged(drawn, order))
            for i, rng, state in zip(ahead.tolist(), copies, states, strict=True):
                self._waiting[i] = state, rng.bit_generator.state

        return begin


def _merged(drawn: Sequence[Drawn[Any, Any]], order: Index) -> Drawn[Any, Any]:
    """Return episodes that were drawn apart as one, in an order."""
    cases, keys, base, spread = zip(*drawn, strict=True)
    all_cases, all_keys, all_base = (list(chain.from_iterable(x)) for x in (cases, keys, base))
    return (
        [all_cases[k] for k in order],
        [all_keys[k] for k in order],
        [all_base[k] for k in order],
        None if spread[0] is None else np.concatenate(spread)[order],
    )
