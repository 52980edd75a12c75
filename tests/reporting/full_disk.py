"""A disk that is full from the k-th file on: the kernel's own failure.

It is a limit to the size of files (RLIMIT_FSIZE, EFBIG in place of ENOSPC), so that SQLite, zip
files and pictures run into it in their own code, a few bytes into a file.
"""

import os
import resource
import sys
from pathlib import Path
from typing import Any

ROOM = 10
"""Bytes of a file that still fit."""
REASONS = ("file too large", "disk i/o error")
_active: list["FullDisk"] = []


class FullDisk:
    """Counts files below a folder that are opened to write; from the k-th on they are cut."""

    def __init__(self, folder: Path, at: int | None = None) -> None:
        self.folder, self.at, self.count = str(folder), at, 0

    def __enter__(self) -> "FullDisk":
        self._limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        _active.append(self)
        return self

    def __exit__(self, *_: object) -> None:
        _active.remove(self)
        resource.setrlimit(resource.RLIMIT_FSIZE, self._limits)

    def open(self, path: Any) -> None:
        """Count a file, and be full from the k-th on."""
        if not isinstance(path, str | bytes | os.PathLike):
            return
        if not os.path.abspath(os.fsdecode(path)).startswith(self.folder + os.sep):
            return
        self.count += 1
        if self.count == self.at:
            resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, self._limits[1]))


def _audit(name: str, arguments: tuple[Any, ...]) -> None:
    if _active and name == "open":
        path, mode, flags = arguments
        if any(x in mode for x in "wax+") if mode else flags & (os.O_WRONLY | os.O_RDWR):
            _active[-1].open(path)


sys.addaudithook(_audit)  # for good: it does nothing while no disk is full
