"""All kinds of log files."""

from __future__ import annotations

from pathlib import Path

from stiction_envs.measured.logs.formats.bag import RosBag
from stiction_envs.measured.logs.formats.base import LogFormat
from stiction_envs.measured.logs.formats.csv_file import CsvFile
from stiction_envs.measured.logs.formats.npz import NumpyArchive
from stiction_envs.measured.logs.formats.parquet import Parquet

FORMATS: tuple[LogFormat, ...] = (CsvFile(), NumpyArchive(), Parquet(), RosBag())
"""In the order in which a path is asked of them."""

ENDS = tuple(end for f in FORMATS for end in f.ends)
"""Ends of the names of files that are read."""


def format_of(path: Path) -> LogFormat | None:
    """Return the kind of a file by its name; of a folder by what is in it."""
    if path.is_dir():
        return next((f for f in FORMATS if f.matches_folder(path)), None)
    return next((f for f in FORMATS if f.matches_file(path)), None)
