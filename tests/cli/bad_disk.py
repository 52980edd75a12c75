"""A disk that fails at the k-th write: full, or read-only from then on.

Writes are counted where the process opens a file of the folder to write, changes names in it, or
commits to SQLite. A full disk is the kernel's own failure: a limit to the size of files
(RLIMIT_FSIZE, EFBIG in place of ENOSPC), so that SQLite, zip files and tensors run into it in
their own code, a few bytes into a file. A read-only folder is raised where Python opens, renames
or removes, since root may write whatever a folder's mode says; in SQLite it is its own refusal.
"""

from __future__ import annotations

import errno
import os
import resource
import sys
from pathlib import Path
from typing import Any, Literal

from sqlalchemy import event
from sqlalchemy.engine import Engine

Kind = Literal["full", "read-only"]
ROOM = 10
"""Bytes of a file that still fit on a full disk."""
CHANGES = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.truncate")
REASONS = ("file too large", "disk i/o error", "read-only file system", "readonly database")

_active: list[BadDisk] = []


class BadDisk:
    """Counts writes below a folder, and fails from the k-th on while it is entered."""

    def __init__(self, folder: Path, at: int | None = None, kind: Kind = "full") -> None:
        self.folder, self.at, self.kind = str(folder), at, kind
        self.count = 0
        self.counts = {"full": 0, "read-only": 0}
        """Writes at which a disk of a kind can fail."""

    def __enter__(self) -> BadDisk:
        self._limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        _active.append(self)
        return self

    def __exit__(self, *_: object) -> None:
        _active.remove(self)
        resource.setrlimit(resource.RLIMIT_FSIZE, self._limits)

    @property
    def broken(self) -> bool:
        return self.at is not None and self.count >= self.at

    def step(self, *, data: bool = True) -> None:
        """Count a write; one without data, of names, a full disk has room for."""
        self.counts["read-only"] += 1
        self.counts["full"] += data
        self.count = self.counts[self.kind]
        if self.broken and self.kind == "full":
            resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, self._limits[1]))

    def change(self, path: Any, *, data: bool = True) -> None:
        """Count a change of a path, or refuse it."""
        if not isinstance(path, str | bytes | os.PathLike):
            return
        name = os.path.abspath(os.fsdecode(path))
        if not (name + os.sep).startswith(self.folder + os.sep):
            return
        self.step(data=data)
        if self.broken and self.kind == "read-only":
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), name)


def _audit(name: str, arguments: tuple[Any, ...]) -> None:
    if not _active:
        return
    disk = _active[-1]
    if name == "open":
        path, mode, flags = arguments
        writes = any(x in mode for x in "wax+") if mode else flags & (os.O_WRONLY | os.O_RDWR)
        if writes:
            disk.change(path)
    elif name in CHANGES:
        path, *rest = arguments
        if not isinstance(path, int) and (os.path.isabs(os.fsdecode(path)) or -1 in rest):
            disk.change(path, data=False)  # else: relative to a descriptor's folder


sys.addaudithook(_audit)  # for good: it does nothing while no disk is bad


@event.listens_for(Engine, "commit")
def _commit(connection: Any) -> None:
    if _active:
        _active[-1].step()


@event.listens_for(Engine, "before_cursor_execute")
def _statement(_: Any, cursor: Any, *__: Any) -> None:
    if _active and _active[-1].broken and _active[-1].kind == "read-only":
        cursor.connection.execute("PRAGMA query_only=ON")
