"""Output folders: files of one run only, and a `provenance.json` that says how they were made.

folder = OutputFolder(path, provenance(...), force=force)        # raises, writes nothing
with folder:                                                     # makes the folder
    write(folder.path / "sje.csv")                               # on success lists the files
"""

import json
import os
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from stiction_envs.errors import StictionError
from stiction_envs.reporting.atomic import is_part, remove_parts, write_text_atomic
from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.reporting.provenance import Provenance

NAME = "provenance.json"


def check_place(path: Path) -> None:
    """Raise if nothing can be written at ``path``."""
    there = path
    while not there.exists() and there != there.parent:
        there = there.parent
    if there != path and not there.is_dir():
        raise StictionError(f"output {path}: {there} is not a folder")
    if not os.access(there, os.W_OK):
        raise StictionError(f"output {path}: no permission to write in {there}")


def check_file(path: Path, suffix: str, *, force: bool) -> None:
    """Raise if no file with this suffix can be written at ``path``, or would replace another."""
    if path.suffix != suffix or path.is_dir():
        what = "is a folder" if path.is_dir() else f"ends in {path.suffix or 'nothing'!r}"
        raise StictionError(f"output {path}: {what}: expected a path to a {suffix}")
    if path.exists() and not force:
        raise StictionError(f"output {path}: exists: choose another name, or force")
    check_place(path)


class OutputFolder:
    """The folder of one run."""

    def __init__(
        self, path: Path, found: Provenance, *, force: bool = False, resumable: bool = False
    ) -> None:
        """Check the folder; nothing is written yet.

        Args:
            path: the folder; it need not exist.
            found: `provenance` of the run.
            force: whether another run's files are replaced.
            resumable: whether the same run may go on in its own folder.

        Raises:
            StictionError: the folder holds other files, or cannot be one.
        """
        self.path = path
        self.provenance = found
        if path.exists() and not path.is_dir():
            raise StictionError(f"output {path}: is a file: expected a folder")
        check_place(path)
        there, before = self._files(), self._read()
        same = before.get("arguments_sha256") == found["arguments_sha256"]
        self.resumed = bool(resumable and same and not force)
        if there and not force and not self.resumed:
            what = f"a run of stiction {before['command']}" if before.get("command") else "files"
            raise StictionError(f"output {path}: holds {what}: choose another folder, or force")
        kept = set(before.get("kept", ()))
        if before.get("finished"):
            self._old = there & set(before.get("files", ()))
        else:  # a run that was interrupted: all but what it found there
            self._old = there - kept if "kept" in before else set()
        self._foreign = kept if self.resumed else there - self._old

    def __enter__(self) -> Self:
        self._made = not self.path.exists()
        self.path.mkdir(parents=True, exist_ok=True)
        if not self.resumed:
            try:
                self._write({"finished": False, "kept": sorted(self._foreign)})
            except OSError:
                self._unmake()
                raise
            # only then: on a full disk the other run's files stay
            for name in self._old:
                self._remove(self.path / name)
        self._before = self._files()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            # of killed processes; not earlier, since a running process may refuse this one
            remove_parts(self.path)
            files = sorted(self._files() - self._foreign)
            self._write({"finished": True, "kept": sorted(self._foreign), "files": files})
        elif not self.wrote and not self.resumed:
            with suppress(OSError):  # the first error matters more
                (self.path / NAME).unlink(missing_ok=True)
            self._unmake()

    @property
    def wrote(self) -> bool:
        """True if the run has put a file into the folder."""
        return bool(self._files() - self._before)

    def _unmake(self) -> None:
        """Remove the folder if it is ours and empty."""
        if self._made:
            with suppress(OSError):
                self.path.rmdir()

    def _files(self) -> set[str]:
        """Return the files in the folder and below, but the provenance, by their paths there."""
        there = (p for p in self.path.rglob("*") if not p.is_dir() and not is_part(p))
        return {p.relative_to(self.path).as_posix() for p in there} - {NAME}

    def _remove(self, file: Path) -> None:
        """Remove a file, and the folders that are empty then."""
        file.unlink(missing_ok=True)
        for folder in file.relative_to(self.path).parents[:-1]:
            if not any((self.path / folder).iterdir()):
                (self.path / folder).rmdir()

    def _read(self) -> JsonRecord:
        try:
            found = json.loads((self.path / NAME).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _write(self, state: dict[str, object]) -> None:
        text = json.dumps(
            {**self.provenance, **state}, indent=2, ensure_ascii=False, sort_keys=True
        )
        write_text_atomic(self.path / NAME, text + "\n")


def default_folder(command: str, robot: str | Path) -> Path:
    """Return ``runs/<command>-<robot>``; for a robot's file its stem."""
    return Path("runs") / f"{command}-{Path(robot).stem}"
