"""All kinds of log files: those of the package, and those that others register."""

from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.formats.bag import RosBag
from stiction_envs.measured.logs.formats.base import Header, LogFormat
from stiction_envs.measured.logs.formats.column_files import NumpyArchive, NumpyArray, Parquet
from stiction_envs.measured.logs.formats.csv_file import HEADERS, CsvFile
from stiction_envs.measured.logs.formats.lerobot import LeRobotDataset
from stiction_envs.measured.logs.formats.mat import MatFile
from stiction_envs.measured.logs.formats.sage import SageFolder

GROUP = "stiction_envs.log_formats"
"""Entry points of other packages: each names a `LogFormat` or `Header`, which is registered."""
_formats: list[LogFormat] = [
    CsvFile(),
    NumpyArchive(),
    NumpyArray(),
    MatFile(),
    Parquet(),
    RosBag(),
    LeRobotDataset(),
    SageFolder(),
]


def register(new: LogFormat | Header) -> None:
    """Register a kind of log file, or the columns of a kind of CSV, for all readers.

    Raises:
        StictionError: ends of names, or a mark, that another kind has.
    """
    if isinstance(new, Header):
        if new.mark in [h.mark for h in HEADERS]:
            raise StictionError(f"log column {new.mark!r} marks another kind: expected a new mark")
        HEADERS.append(new)
        return
    taken = sorted({e for f in _formats for e in f.ends} & set(new.ends))
    if taken or not new.ends or not all(e.startswith(".") for e in new.ends):
        raise StictionError(
            f"log format with ends {new.ends}: expected one or more, with the dot, other than "
            f"{', '.join(e for f in _formats for e in f.ends)}"
        )
    _formats.append(new)


@cache
def _load_entry_points() -> None:
    for point in entry_points(group=GROUP):
        register(point.load())


def log_ends() -> tuple[str, ...]:
    """Return the ends of the names of files that are read."""
    _load_entry_points()
    return tuple(end for f in _formats for end in f.ends)


def format_of(path: Path) -> LogFormat | None:
    """Return the kind of a file by its name; of a folder by what is in it."""
    _load_entry_points()
    if path.is_dir():
        kinds = (f for f in _formats if f.inside)
        return next((f for f in kinds if all((path / x).is_file() for x in f.inside)), None)
    return next((f for f in _formats if path.name.lower().endswith(f.ends)), None)
