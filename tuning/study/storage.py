"""Storage of studies: a SQLite file, or a database that machines share."""

import fcntl
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import optuna
from optuna.storages import RDBStorage, RetryHeartbeatStaleTrialCallback
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, OperationalError, SQLAlchemyError

from stiction_envs.errors import ExperimentError, StictionError, missing_extra
from tuning.settings import SharedSettings, tuning_settings

POSTGRES = "postgresql+psycopg"
OPENINGS = 5
"""Tries to create the tables (assumed): machines that start together can block each other."""


def open_storage(storage: str, settings: SharedSettings | None = None) -> RDBStorage:
    """Return a storage by its URL (``sqlite:///FILE``, ``postgresql+psycopg://…``).

    Raises:
        StictionError: no URL, or one that cannot be reached or read; passwords are not shown.
    """
    url = parse(storage)
    try:
        if not is_shared(url):
            return RDBStorage(_template(url))
        s = settings or tuning_settings().shared
        for _ in range(OPENINGS - 1):
            try:
                return _shared_database(url, s)
            except OperationalError:  # no connection: further tries would take as long
                raise
            except SQLAlchemyError:
                continue
        return _shared_database(url, s)
    except ImportError:
        raise missing_extra(f"storage {shown(url)}", "psycopg", "postgres") from None
    except (SQLAlchemyError, optuna.exceptions.OptunaError) as error:
        text = reason_of(error)
        for secret in filter(None, (url.password, *url.query.values())):
            text = text.replace(str(secret), "***")
        raise StictionError(f"storage {shown(url)}: cannot be opened: {text}") from None


def is_shared(url: URL) -> bool:
    """Return whether machines can share a storage: a database server, not a file."""
    return url.drivername == POSTGRES


def storage_file(url: URL) -> Path | None:
    """Return the file of a storage, None for a database server or one in memory."""
    if is_shared(url) or url.database in (None, "", ":memory:"):
        return None
    return Path(str(url.database))


def shown(url: URL) -> str:
    """Return a URL without password and options, for printing."""
    return url.set(query={}).render_as_string(hide_password=True)


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
def writing(
    place: str, kind: type[StictionError] = ExperimentError, what: str = ""
) -> Iterator[None]:
    """Raise an error of a ``kind`` in place of what Optuna, SQLAlchemy or the system raises.

    The message has one line; ``place`` is the storage as it may be printed (`shown`).
    """
    try:
        yield
    except (optuna.exceptions.StorageInternalError, SQLAlchemyError, OSError) as error:
        raise kind(f"storage {place}: {what}{reason_of(error)}") from error


def parse(text: str) -> URL:
    """Return the parts of a URL of SQLite or of PostgreSQL, whose driver is psycopg."""
    if text.partition("://")[2].count("@") > 1:
        # what follows the first one would be taken for the host, and printed
        raise StictionError("storage: more than one @ in the URL: expected %40 in a password")
    try:
        url = make_url(text)
    except (ArgumentError, ValueError):
        expected = "a URL such as sqlite:///study.db or postgresql+psycopg://USER@HOST/NAME"
        raise StictionError(f"storage: expected {expected}") from None
    if url.drivername in ("postgres", "postgresql"):
        url = url.set(drivername=POSTGRES)
    if url.drivername not in ("sqlite", POSTGRES):
        raise StictionError(
            f"storage {shown(url)}: unknown kind: expected sqlite or postgresql+psycopg"
        )
    return url


@cache
def _shared_database(url: URL, settings: SharedSettings) -> RDBStorage:
    """Return the storage of a database server, one for all studies to use few connections."""
    connect = {
        "connect_timeout": int(settings.connect_s),
        # a host that disappears is noticed within two probes 5 s apart (assumed)
        "keepalives_idle": int(settings.connect_s),
        "keepalives_interval": 5,
        "keepalives_count": 2,
        "tcp_user_timeout": int(2000 * settings.connect_s),
        # heartbeats of all machines are in one time zone
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


def reason_of(error: BaseException) -> str:
    """Return the first line of the driver's own message, which other errors may wrap."""
    cause = getattr(error, "orig", None) or error.__cause__ or error
    cause = getattr(cause, "orig", None) or cause
    if isinstance(cause, OSError) and cause.strerror:
        return cause.strerror.lower()
    said = [line.strip() for line in str(cause).splitlines() if line.strip()] or [""]
    text = said[0].rsplit("failed: ", 1)[-1].removeprefix("FATAL:").strip()
    return text or type(cause).__name__
