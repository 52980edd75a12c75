"""Low-pass filters of values that every simulation has of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.control.settings import numbers
from stiction_envs.errors import StictionError

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Rows = Index | slice


class Filtered:
    """A row per simulation that follows its target: x ← x + s (target − x)."""

    def __init__(self, shape: tuple[int, ...], step: float) -> None:
        self.value, self.target, self.step = np.zeros(shape), np.zeros(shape), step

    def put(self, rows: Rows, value: ArrayLike, now: bool = False) -> None:
        """Set the target of some rows; where the filter is off, or ``now``, the value too."""
        self.target[rows] = value
        if now or self.step == 1.0:
            self.value[rows] = value

    def advance(self) -> bool:
        """One cycle; False where the filter is off."""
        if self.step == 1.0:
            return False
        self.value += self.step * (self.target - self.value)
        return True


def rows_of(ids: ArrayLike | None) -> Rows:
    """Return what picks simulations ``ids`` (M,), or all for None."""
    return slice(None) if ids is None else np.asarray(ids)


def fill(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """``value`` as array of ``shape`` (M, …); (M,) is one number per simulation."""
    array = numbers(name, value, low=-np.inf if name.startswith("coupling") else 0.0)
    if array.ndim == 1 and len(shape) == 2:
        array = array[:, None]
    try:
        return np.array(np.broadcast_to(array, shape))
    except ValueError:
        raise StictionError(
            f"impedance {name} has shape {np.shape(value)}: expected one number, "
            f"({shape[0]},) or {shape}"
        ) from None
