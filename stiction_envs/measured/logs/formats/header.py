"""The first line of a CSV log: ours, or that of a robot's own logger."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Header:
    """Columns of one kind of CSV log."""

    mark: str
    """A column that no other kind has."""
    column: Callable[[str], str]
    """Our name of a column (`logs.columns`); itself where nothing of ours is in it."""
    per_second: float
    """Units of its time in a second."""
    side: str | None
    """Side of the gear on which its torque is measured, where that is known: motor or link."""
    note: str
    """Note for a person about such a log; empty for ours."""

    def ours(self, names: Sequence[str]) -> list[str]:
        """Return our names of its columns."""
        return [self.column(name.strip()) for name in names]


OUR_COLUMNS = Header(mark="t", column=str, per_second=1.0, side=None, note="")
"""``t,q1..qn,dq1..dqn,tau1..taun`` [s, rad, rad/s, N·m]."""
