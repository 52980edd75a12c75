"""Columns of every joint, as they were made: nothing is copied when others come."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class JointColumns:
    """Columns of n joints over T rows, in parts of columns that were added together."""

    def __init__(self, joints: int, rows: int) -> None:
        self._nothing = np.empty((0, rows))
        self.parts: list[list[Array]] = [[self._nothing] for _ in range(joints)]
        """Parts of each joint, (k, T) each, in their order, the first without columns; not to be
        changed."""
        self.width = [0] * joints
        """Number of columns of each joint."""
        self._part_of: list[dict[int, Array]] = [{} for _ in range(joints)]

    def add(self, joint: int, columns: Array) -> tuple[int, ...]:
        """Keep (k, T) columns, which must not change; return their numbers."""
        start = self.width[joint]
        self.parts[joint].append(columns)
        self._part_of[joint][start] = columns
        self.width[joint] += len(columns)
        return tuple(range(start, self.width[joint]))

    def at(self, joint: int, numbers: tuple[int, ...]) -> Array:
        """Return (k, T) columns that were added together; not to be changed."""
        return self._part_of[joint][numbers[0]]

    def keep(self, joint: int, some: Iterable[tuple[int, ...]]) -> None:
        """Give back the memory of a joint's columns, but of some that `at` is asked for later."""
        mine = self._part_of[joint]
        self.parts[joint] = [self._nothing]
        self._part_of[joint] = {x[0]: mine[x[0]] for x in some if x}
