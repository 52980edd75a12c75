"""A model as a choice of columns of every joint, and of the coefficients that these share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
MOST_MODELS = 64
"""Number of models whose columns are kept as arrays [-]; assumed: two or three are compared."""


@dataclass(frozen=True)
class ModelColumns:
    """Columns of a model: for each joint which of its columns, and which coefficient each has.

    A coefficient that several joints share (payload, tilt, delay) appears in several. The first
    ``random`` columns of every joint, and coefficients, are random effects, and not listed.
    """

    columns: tuple[tuple[int, ...], ...]
    coefficients: tuple[tuple[int, ...], ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    firm: tuple[float, ...] = ()
    """Prior precision of each coefficient about zero; () for none."""
    random: int = 0
    """Number of random effects, which have no bounds."""

    @property
    def prior(self) -> Array:
        """(P,) that precision."""
        return np.array(self.firm) if self.firm else np.zeros(len(self.low))

    @cached_property
    def _hash(self) -> int:
        return hash((self.columns, self.coefficients, self.low, self.high, self.firm, self.random))

    def __hash__(self) -> int:
        """Return what is computed once: models of hundreds of numbers are looked up often."""
        return self._hash

    @cached_property
    def named(self) -> list[tuple[int, Index, Index]]:
        """The joints with columns: number, the columns that are listed, and their coefficients."""
        both = zip(self.columns, self.coefficients, strict=True)
        return [
            (j, np.array(x, dtype=np.int64), np.array(at, dtype=np.int64))
            for j, (x, at) in enumerate(both)
            if x or self.random
        ]


@lru_cache(maxsize=MOST_MODELS)
def of_joints(model: ModelColumns) -> list[tuple[int, Index, Index]]:
    """Return the joints with columns: number, columns, random ones too, and their coefficients."""
    r = np.arange(model.random)
    return [(j, np.concatenate([r, x]), np.concatenate([r, at])) for j, x, at in model.named]
