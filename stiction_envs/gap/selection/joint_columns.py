"""Columns of every joint, as they were made: nothing is copied when others come.

They are in single precision, which halves the memory of a diagnosis: rounded by 6·10⁻⁸ of their
size, far below any sensor's noise. Their sums are in double precision (`Gram`).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Kept = NDArray[np.float32]
"""(k, T) columns of one candidate."""


class JointColumns:
    """Columns of n joints over T rows, in parts of columns that were added together."""

    def __init__(self, joints: int, rows: int) -> None:
        self._nothing = np.empty((0, rows), dtype=np.float32)
        self.parts: list[list[Kept]] = [[self._nothing] for _ in range(joints)]
        """Parts of each joint, (k, T) each, in their order, the first without columns; not to be
        changed."""
        self.width = [0] * joints
        """Number of columns of each joint."""
        self._part_of: list[dict[int, Kept]] = [{} for _ in range(joints)]

    def add(self, joint: int, columns: Kept) -> tuple[int, ...]:
        """Keep (k, T) columns, which must not change; return their numbers."""
        start = self.width[joint]
        self.parts[joint].append(columns)
        self._part_of[joint][start] = columns
        self.width[joint] += len(columns)
        return tuple(range(start, self.width[joint]))

    def at(self, joint: int, numbers: tuple[int, ...]) -> Kept:
        """Return (k, T) columns that were added together; not to be changed."""
        return self._part_of[joint][numbers[0]] if numbers else self._nothing

    def holds(self, joint: int, numbers: tuple[int, ...]) -> bool:
        """Whether `at` has these columns."""
        return bool(numbers) and numbers[0] in self._part_of[joint]

    def keep(self, joint: int, some: Iterable[tuple[int, ...]]) -> None:
        """Give back the memory of a joint's columns, but of some that `at` is asked for later."""
        mine = self._part_of[joint]
        self.parts[joint] = [self._nothing]
        self._part_of[joint] = {x[0]: mine[x[0]] for x in some if x}
