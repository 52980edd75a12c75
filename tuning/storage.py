"""Where studies are kept: a SQLite file, a journal, or a database that machines share."""

from __future__ import annotations

from pathlib import Path

import optuna
from optuna.storages import BaseStorage, JournalStorage
from optuna.storages.journal import JournalFileBackend
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, SQLAlchemyError

from stiction_envs.errors import StictionError

JOURNAL = ("journal", "jsonl", "log")
"""Ends of names of files that hold a journal."""


def open_storage(storage: str | Path) -> BaseStorage:
    """Return a storage by its URL (``sqlite:///FILE``, ``postgresql+psycopg://…``) or journal file.

    Raises:
        StictionError: neither, or one that cannot be reached; passwords are not shown.
    """
    text = str(storage)
    if "://" not in text:
        if text.rsplit(".", 1)[-1] not in JOURNAL:
            ends = ", ".join(f".{end}" for end in JOURNAL)
            raise StictionError(f"storage {text}: expected a URL, or a file that ends in {ends}")
        return JournalStorage(JournalFileBackend(text))
    try:
        shown = make_url(text).render_as_string(hide_password=True)
    except ArgumentError:
        raise StictionError("storage: expected a URL such as sqlite:///study.db") from None
    try:
        return optuna.storages.RDBStorage(text)
    except (SQLAlchemyError, ImportError, optuna.exceptions.OptunaError) as error:
        cause = type(error.__cause__ or error).__name__
        raise StictionError(f"storage {shown}: cannot be opened ({cause})") from None
