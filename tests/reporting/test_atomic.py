from __future__ import annotations

import os

import pytest

from stiction_envs.reporting.atomic import write_text_atomic


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
