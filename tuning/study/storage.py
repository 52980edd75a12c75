"""Where studies are kept: a SQLite file, a journal, or a database that machines share."""

from __future__ import annotations

import fcntl
import json
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO

import optuna
from optuna.storages import (
    BaseStorage,
    JournalStorage,
    RDBStorage,
    RetryHeartbeatStaleTrialCallback,
)
from optuna.storages.journal import JournalFileBackend
from optuna.storages.journal._file import BaseJournalFileLock
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, NoSuchModuleError, OperationalError, SQLAlchemyError

from stiction_envs.errors import ExperimentError, StictionError, missing_extra
from tuning.settings import SharedSettings, tuning_settings

JOURNAL = ("journal", "jsonl", "log")
"""File name extensions of a journal."""
OPENINGS = 5
"""Tries to create the tables (assumed): machines that start together can block each other."""


def open_storage(storage: str | Path, settings: SharedSettings | None = None) -> BaseStorage:
    """Return a storage by its URL (``sqlite:///FILE``, ``postgresql+psycopg://…``) or journal file.

    If the last line of a journal is half-written (power failure), it is dropped with a warning; its
    trial is evaluated again.

    Args:
        storage: URL, or a file whose name ends in one of `JOURNAL`.
        settings: time limits for a shared database; None for the defaults.

    Raises:
        StictionError: neither, or one that cannot be reached or read; passwords are not shown.
    """
    text = str(storage)
    if "://" not in text:
        return _open_journal(_journal_file(text))
    url = _parse(text)
    shared = is_shared(text)
    s = settings or tuning_settings().shared
    try:
        for left in range(OPENINGS - 1, -1, -1):
            try:
                return _shared_database(url, s) if shared else RDBStorage(_template(url))
            except OperationalError:
                raise
            except SQLAlchemyError:
                if left == 0 or not shared:
                    raise
        raise AssertionError
    except (SQLAlchemyError, ImportError, optuna.exceptions.OptunaError) as error:
        raise _cannot_open(url, error) from None


def is_shared(storage: str | Path) -> bool:
    """Return whether machines can share a storage: a database server, not a file."""
    text = str(storage)
    return "://" in text and _parse(text).get_backend_name() != "sqlite"


def storage_file(storage: str | Path) -> Path | None:
    """Return the file of a storage, None for a database server or one in memory."""
    text = str(storage)
    if "://" not in text:
        return _journal_file(text)
    url = _parse(text)
    if url.get_backend_name() != "sqlite" or url.database in (None, "", ":memory:"):
        return None
    return Path(str(url.database))


def shown(storage: str | Path) -> str:
    """Return a storage without password and options, for printing."""
    text = str(storage)
    return _shown(_parse(text)) if "://" in text else text


@contextmanager
def only_writer(file: Path) -> Iterator[None]:
    """Lock a storage's file, so that no second process fills the same study.

    Raises:
        StictionError: another process holds it.
    """
    with file.open("rb") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StictionError(
                f"storage {file}: another process is filling it: expected one at a time, or a "
                "database that machines share (postgresql+psycopg://…)"
            ) from None
        yield


@contextmanager
def writing(place: str) -> Iterator[None]:
    """Replace the errors of a study that cannot be written or read by one line (a full disk, say).

    Args:
        place: the storage as it may be printed (`shown`).

    Raises:
        ExperimentError: in place of what Optuna, SQLAlchemy or the system raised.
    """
    try:
        yield
    except (optuna.exceptions.StorageInternalError, SQLAlchemyError, OSError) as error:
        raise ExperimentError(f"storage {place}: {reason_of(error)}") from error


# ---- databases -----------------------------------------------------------------------------------


def _parse(text: str) -> URL:
    """Return the parts of a URL; PostgreSQL's driver is psycopg unless another one is named."""
    expected = "expected a URL such as sqlite:///study.db or postgresql+psycopg://USER@HOST/NAME"
    if text.split("://", 1)[1].count("@") > 1:
        # what follows the first one would be taken for the host, and printed
        raise StictionError("storage: more than one @ in the URL: expected %40 in a password")
    try:
        url = make_url(text)
        url.get_backend_name()
    except (ArgumentError, ValueError):
        raise StictionError(f"storage: {expected}") from None
    if url.drivername in ("postgres", "postgresql"):
        url = url.set(drivername="postgresql+psycopg")
    return url


def _shown(url: URL) -> str:
    return url.set(query={}).render_as_string(hide_password=True)


@cache
def _shared_database(url: URL, settings: SharedSettings) -> RDBStorage:
    """Return the storage of a database server, one for all studies to use few connections."""
    connect: dict[str, object] = {}
    if url.get_backend_name() == "postgresql":
        connect = {"connect_timeout": int(settings.connect_s)}
        if url.get_driver_name() == "psycopg":
            # a host that disappears is noticed within two probes 5 s apart (assumed);
            # heartbeats of all machines are in one time zone
            connect |= {
                "keepalives_idle": int(settings.connect_s),
                "keepalives_interval": 5,
                "keepalives_count": 2,
                "tcp_user_timeout": int(2000 * settings.connect_s),
                "options": "-c timezone=UTC",
            }
    connect = {k: v for k, v in connect.items() if k not in url.query}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        return RDBStorage(
            _template(url),
            engine_kwargs={"pool_pre_ping": True, "connect_args": connect},
            heartbeat_interval=int(settings.heartbeat_s),
            grace_period=int(settings.grace_s),
            heartbeat_stale_trial_callback=RetryHeartbeatStaleTrialCallback(),
        )


def _template(url: URL) -> str:
    """Return a URL with its password; Optuna interprets braces."""
    text = url.render_as_string(hide_password=False)
    return text.replace("{", "{{").replace("}", "}}")


def _cannot_open(url: URL, error: BaseException) -> StictionError:
    """Return one line about a database that cannot be opened, without its password."""
    place = f"storage {_shown(url)}"
    if isinstance(error, NoSuchModuleError):
        return StictionError(f"{place}: unknown kind: expected sqlite or postgresql+psycopg")
    if isinstance(error, ImportError):
        driver = url.get_driver_name()
        if driver == "psycopg":
            return missing_extra(place, driver, "postgres")
        return StictionError(f"{place}: Python package of {driver} is missing")
    text = reason_of(error)
    for secret in (url.password, *url.query.values()):
        if secret:
            text = text.replace(str(secret), "***")
    return StictionError(f"{place}: cannot be opened: {text}")


def reason_of(error: BaseException) -> str:
    """Return the first line of the driver's own message, which other errors may wrap."""
    cause = getattr(error, "orig", None) or error.__cause__ or error
    cause = getattr(cause, "orig", None) or cause
    if isinstance(cause, OSError) and cause.strerror:
        return cause.strerror.lower()  # a journal's error
    said = [line.strip() for line in str(cause).splitlines() if line.strip()] or [""]
    text = said[0].rsplit("failed: ", 1)[-1].removeprefix("FATAL:").strip()
    return text or type(cause).__name__


# ---- journals ------------------------------------------------------------------------------------


class _ProcessLock(BaseJournalFileLock):
    """Lock of a journal that ends with its process; Optuna's own lasts half a minute longer."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._held: IO[bytes] | None = None

    def acquire(self) -> bool:
        self._held = self._file.open("r+b")
        fcntl.lockf(self._held, fcntl.LOCK_EX)
        return True

    def release(self) -> None:
        if self._held is not None:
            self._held.close()
            self._held = None


def _journal_file(text: str) -> Path:
    if text.rsplit(".", 1)[-1] not in JOURNAL:
        ends = ", ".join(f".{end}" for end in JOURNAL)
        raise StictionError(f"storage {text}: expected a URL, or a file that ends in {ends}")
    return Path(text)


def _open_journal(file: Path) -> JournalStorage:
    try:
        file.touch()
        _drop_torn_line(file)
        return JournalStorage(JournalFileBackend(str(file), lock_obj=_ProcessLock(file)))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise StictionError(f"journal {file}: cannot be opened: {reason}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, StictionError):
            raise
        raise StictionError(f"journal {file}: its lines are no operations of Optuna") from None


def _drop_torn_line(file: Path) -> None:
    """Remove a half-written last line, or the next one would be appended to it."""
    with file.open("r+b") as stream:
        fcntl.lockf(stream, fcntl.LOCK_EX)
        end, begun = 0, False
        for number, line in enumerate(stream, start=1):
            if _is_operation(line):
                end += len(line)
                continue
            first = b'{"op_code"'
            begun = number > 1 or line.startswith(first) or first.startswith(line)
            if not begun or stream.read(1):
                raise StictionError(
                    f"journal {file}: line {number} is damaged: expected one operation of Optuna a "
                    "line; only a half-written last one is repaired"
                )
        if not begun:
            return
        stream.truncate(end)
        os.fsync(stream.fileno())
    warnings.warn(
        f"journal {file}: the last line was half-written and is dropped; what was in it is "
        "evaluated again",
        stacklevel=4,
    )


def _is_operation(line: bytes) -> bool:
    if not line.endswith(b"\n"):
        return False
    try:
        found = json.loads(line)
    except ValueError:
        return False
    return isinstance(found, dict) and "op_code" in found
