"""One bad reading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from stiction_envs.gap.tables.causes.base import Hypothesis, TableCause, Wheres
from stiction_envs.gap.tables.readings import Comparison, TableData


class CorruptedCell(TableCause):
    """A reading far from the model, its neighbours and its repeats.

    It has no parameter to fit: `diagnosis` finds it in what all other causes leave.
    """

    name, parameter = "corrupted_cell", ""

    def statements(self, wheres: Mapping[int, Wheres]) -> Iterator[Hypothesis]:
        """Yield none."""
        yield from ()

    def span(self, data: TableData, where: Wheres) -> tuple[float, float]:
        """Return no range."""
        return 0.0, 0.0

    def evidence(self, some: Sequence[Hypothesis], x: Sequence[float], seen: Comparison) -> str:
        """Return nothing: `describe` does it for a reading."""
        return ""

    def outside_model(self, values: Mapping[str, float]) -> str:
        """Return that it is not a property of the arm."""
        return "a bad reading"

    def describe(self, i: int, seen: Comparison) -> str:
        """Return the reading, its prediction, and the error of the other readings of its kind."""
        r, x = seen.data.readings, seen.data.readings.all[i]
        off = 100 * (r.torque - seen.with_it) / seen.data.unit
        near = [k for k, y in enumerate(r.all) if y.where == x.where and k != i]
        what = "base torque" if x.is_base else f"{x.frequency:g} Hz, {x.amplitude:.4g} N·m"
        expected = x.where.sign * seen.with_it[i]
        return (
            f"joint {x.where.joint} {x.where.load} {x.where.direction}, {what}: "
            f"{x.where.sign * x.torque:.4f} N·m is read where {expected:.4f} N·m is expected; the "
            f"other {len(near)} readings of this pose and direction are within "
            f"{np.abs(off[near]).max():.0f} % of the friction, this one is {off[i]:+.0f} % off"
        )
