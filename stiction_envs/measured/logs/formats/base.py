"""The interface of a kind of log file: ends of its names, its reader, how many joints it has.

Files may be hostile: every size is bounded before memory is taken, and nothing is unpickled.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.aliases import OurNames, listed_names, our_names
from stiction_envs.measured.logs.columns import Columns, Wanted, sort_columns
from stiction_envs.measured.logs.corrections import RawLog
from stiction_envs.measured.logs.joint_names import Naming

MOST_BYTES = 2**31  # most bytes of one file, unpacked; assumed
MOST_VALUES = 70_000_000
"""Most numbers of one file that are used. Source: 50 minutes at 1 kHz of t, q, dq and tau of 7
joints."""
MOST_LINE_BYTES = 2**16  # most bytes of one line of text; assumed
Arrays = dict[str, NDArray[Any]]
"""Arrays of any kind of value, by name."""


class LogFormat(ABC):
    """One kind of file."""

    ends: ClassVar[tuple[str, ...]]
    """Ends of the names of such files, with the dot."""
    inside: ClassVar[tuple[str, ...]] = ()
    """Files in a folder of this kind; () for files only."""
    has_units: ClassVar[bool] = False
    """Whether its reader brings angles to rad; else its angles are those of `Naming.units`."""

    @abstractmethod
    def read(self, where: str, wanted: Wanted) -> RawLog:
        """Read the numbers of a file; raise a StictionError for no log of such a robot."""

    @abstractmethod
    def names(self, where: str, naming: Naming) -> list[str]:
        """Return our names of what it holds, as the columns of a CSV; others do not count."""


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
            naming: names of the joints.
            n_joints: joints of the robot; None where none is known.

        Raises:
            StictionError: joints that have names cannot be found.
        """
        return [self.column(name.strip()) for name in names]


OUR_COLUMNS = Header(mark="t", column=str, per_second=1.0, side=None, note="")
"""``t,q1..qn,dq1..dqn,tau1..taun`` [s, rad, rad/s, N·m]."""


class ColumnFile(LogFormat):
    """A kind of file that holds arrays by the names of its columns."""

    @abstractmethod
    def columns(self, where: str) -> Arrays:
        """Read columns (T,), or matrices (T, n) by the name of their channel."""

    def names(self, where: str, naming: Naming) -> list[str]:
        flat, naming = _flat(where, self.columns(where), naming)
        return our_names(where, list(flat), naming).names

    def read(self, where: str, wanted: Wanted) -> RawLog:
        flat, naming = _flat(where, self.columns(where), wanted.naming)
        ours = our_names(where, list(flat), naming, wanted.n_joints)
        names = list(flat)
        columns = sort_columns(where, ours.names, wanted, names)
        used = columns.numbers if columns.run is None else (*columns.numbers, columns.run)
        length = len(flat[names[used[0]]])
        for c in used:
            name, array = names[c], flat[names[c]]
            if len(array) != length:
                raise StictionError(
                    f"{where}: column {name!r} has {len(array)} rows, "
                    f"{names[used[0]]!r} has {length}: expected one length for all"
                )
            if c != columns.run and array.dtype.kind not in "fiu":
                raise StictionError(
                    f"{where}: column {name!r} holds {array.dtype}: expected numbers"
                )
        check_size(where, length, len(used))
        rows = range(1, length + 1)
        return log_of_columns(where, columns, ours, lambda c: flat[names[c]], wanted, "row", rows)


def held(told: NDArray[np.number[Any]], at: NDArray[np.number[Any]]) -> tuple[Index, Bools]:
    """Return which of the commands at times (K,) holds at others (T,), and where one does."""
    last = np.searchsorted(told, at, side="right") - 1
    return np.maximum(last, 0), last >= 0


@contextmanager
def damaged(message: str) -> Iterator[None]:
    """Make any failure of a reader one error: damaged files make libraries raise anything."""
    try:
        yield
    except StictionError:
        raise
    except Exception:
        raise StictionError(message) from None


def check_bytes(where: str, size: int, most: int = MOST_BYTES) -> None:
    """Raise if a file, or what it unpacks to, has more bytes than are read."""
    if size > most:
        raise StictionError(f"{where}: over {most >> 20} MiB: expected a shorter log")


def check_size(where: str, rows: int, per_row: int) -> None:
    """Raise if a log has more numbers than are read."""
    if rows * per_row > MOST_VALUES:
        raise StictionError(
            f"{where}: {rows} rows or more: expected at most {MOST_VALUES} numbers in one log; "
            "split it or thin it out"
        )


def _flat(where: str, arrays: Arrays, naming: Naming) -> tuple[Arrays, Naming]:
    """Return columns, those of matrices by channel and joint, and names that are not yet given.

    A matrix without a name, or the only one beside names for all its columns, is a table.
    """
    listed = listed_names(naming.columns)
    tables = {name: x for name, x in arrays.items() if x.ndim == 2}
    if "" in tables or (listed and len(tables) == 1):
        (table,) = tables.values()
        if len(listed) != table.shape[1]:
            raise StictionError(
                f"{where}: {table.shape[1]} columns without names: expected columns with a name "
                "for each, as in columns t q1..q6 tau1..tau6"
            )
        others = tuple(word for word in naming.columns if "=" in word)
        return dict(zip(listed, table.T, strict=True)), replace(naming, columns=others)
    flat: Arrays = {}
    for name, array in arrays.items():
        if array.ndim == 2 and array.shape[1] < 100:
            flat.update({f"{name}{j + 1}": array[:, j] for j in range(array.shape[1])})
        elif array.ndim == 1:
            flat[name] = array
    return flat, naming


def log_of_columns(
    where: str,
    columns: Columns,
    ours: OurNames,
    column: Callable[[int], NDArray[Any]],
    wanted: Wanted,
    word: str,
    rows: Sequence[int] | NDArray[np.integer[Any]],
) -> RawLog:
    """Return the log of a table; ``word`` and a number of ``rows`` (T,) say where a row is.

    ``column`` returns a column (T,) by its place; that of the runs may hold anything.
    """
    run = np.zeros(len(rows), np.int64)
    if columns.run is not None and len(rows):
        label = column(columns.run)
        run[1:] = np.cumsum(label[1:] != label[:-1])

    def converted(c: int) -> Array:
        values = np.asarray(column(c), np.float64)
        return values * ours.factors[c] if c in ours.factors else values

    log = RawLog(
        source=where,
        t=np.array(converted(columns.t)) if wanted.time else np.arange(float(len(rows))),
        data={
            channel: np.stack([converted(c) for c in group], axis=1)
            for channel, group in columns.channels.items()
        },
        run=run,
        place=lambda i: f"{where}, {word} {rows[i]}",
        ignored=columns.ignored,
    )
    for text in ours.notes:
        log.note(text)
    return log
