"""Files that are either there in full or not at all."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PART = re.compile(r"\..+\.\d+\.part(\.mp4)?")


def write_text_atomic(path: str | os.PathLike[str], text: str) -> None:
    """Write UTF-8 ``text`` to ``path`` at once; a failure leaves what was there before.

    Line ends are written as they are in ``text``, so that files are the same on every system.
    """
    write_bytes_atomic(path, text.encode())


def write_bytes_atomic(path: str | os.PathLike[str], data: bytes) -> None:
    """Write ``data`` to ``path`` at once; a failure leaves what was there before.

    Raises:
        OSError: it cannot be written; its ``filename`` is ``path``.
    """
    path = Path(path)
    # in the target's folder, since a rename is atomic only within one file system
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with naming(path):
            with open(part, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, path)
    except BaseException:
        # the first error matters more than one of removing the part
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Add the file's name to an OSError: that of a full disk has none."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OSError(error.errno, reason, os.fspath(path)) from error


def is_part(path: Path) -> bool:
    """Return whether a file is half-written, by a running process or by one that was killed."""
    return _PART.fullmatch(path.name) is not None


def remove_parts(folder: Path) -> None:
    """Remove half-written files of killed processes from a folder and those below."""
    for part in folder.rglob(".*.part*"):
        if is_part(part):
            part.unlink(missing_ok=True)
