"""The first line of a CSV log: ours, or that of a robot's own logger."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stiction_envs.measured.logs.joint_names import Naming


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
    has_names: bool = False
    """Whether its joints have names, so that `Naming` applies."""
    sparse: bool = False
    """Whether a row has only what changed."""

    def ours(
        self, names: Sequence[str], where: str, naming: Naming, n_joints: int | None = None
    ) -> list[str]:
        """Return our names of the columns of a file.

        Args:
            names: of the columns in the file.
            where: the file, the beginning of every message.
            naming: names of its joints.
            n_joints: joints of the robot; None where none is known.

        Raises:
            StictionError: joints that have names cannot be found.
        """
        return [self.column(name.strip()) for name in names]


OUR_COLUMNS = Header(mark="t", column=str, per_second=1.0, side=None, note="")
"""``t,q1..qn,dq1..dqn,tau1..taun`` [s, rad, rad/s, N·m]."""
