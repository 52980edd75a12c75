import errno
import os
from pathlib import Path

import pytest

from stiction_envs.reporting.atomic import remove_parts, write_text_atomic


def test_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    write_text_atomic(path, "old ü\n")

    def broken(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(OSError, match="disk full"):
        write_text_atomic(path, "new\n")
    assert path.read_bytes() == "old ü\n".encode()
    assert list(tmp_path.iterdir()) == [path]


def refused(*_: object, **__: object) -> None:
    raise OSError(errno.EROFS, "Read-only file system", "another name")


def test_an_error_names_the_file_that_could_not_be_written(tmp_path, monkeypatch):
    """Though the half of it cannot be removed either, and a full disk's error names no file."""
    monkeypatch.setattr(Path, "unlink", refused)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as caught:
        write_text_atomic(tmp_path / "a.csv", "new\n")
    assert caught.value.errno == errno.ENOSPC
    assert caught.value.filename == str(tmp_path / "a.csv")


def test_only_our_half_written_files_are_removed(tmp_path):
    for name in (".a.csv.12.part", ".a.12.part.mp4", ".mine.part", "a.12.part"):
        (tmp_path / name).touch()
    remove_parts(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {".mine.part", "a.12.part"}
