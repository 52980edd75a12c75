"""Columns of every joint, side by side in memory that grows with them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ROOM = 256
"""Initial capacity for columns of a joint; assumed."""


class JointColumns:
    """Columns of n joints over T rows, each contiguous; numbered as they were added."""

    def __init__(self, joints: int, rows: int) -> None:
        self._nothing = np.empty((0, rows))
        self._columns = [self._nothing] * joints
        self.width = [0] * joints
        """Number of columns of each joint."""

    def add(self, joint: int, columns: Array) -> tuple[int, ...]:
        """Store (k, T) columns with spare capacity; return their numbers.

        Unused capacity takes no memory.
        """
        start, end = self.width[joint], self.width[joint] + len(columns)
        if end > len(self._columns[joint]):
            before = self._columns[joint][:start]
            self._columns[joint] = np.empty((max(ROOM, 2 * end), self._nothing.shape[1]))
            self._columns[joint][:start] = before
        self._columns[joint][start:end] = columns
        self.width[joint] = end
        return tuple(range(start, end))

    def of(self, joint: int) -> Array:
        """Return (T, P) all columns of a joint; not to be changed."""
        return self._columns[joint][: self.width[joint]].T

    def at(self, joint: int, numbers: tuple[int, ...]) -> Array:
        """Return (T, k) columns that were added together; not to be changed."""
        return self._columns[joint][numbers[0] : numbers[-1] + 1].T

    def free(self, joint: int) -> None:
        """Give the memory of a joint's columns back; they cannot be asked for afterwards."""
        self._columns[joint] = self._nothing
