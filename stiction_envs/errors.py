"""Errors of the package: `StictionError`, of which `ExperimentError` is one kind."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class StictionError(ValueError):
    """Bad input: the message is one line and says what, where, and what was expected.

    The command line turns it into exit code 2; nothing has been written when it is raised.
    """


class ExperimentError(StictionError):
    """The input was fine, but the simulated experiment failed: exit code 1 on the command line.

    An arm that cannot be held in its pose, a joint that sticks, a calibration that does not
    converge. The message is one line.
    """


def one_line(error: object) -> str:
    """Return a text, or what an error says, with every run of white space as one blank.

    An error without a text is named by its type.
    """
    return " ".join(str(error).split()) or type(error).__name__


def unknown(what: str, value: object, expected: Iterable[object]) -> StictionError:
    """Error for a ``value`` that is not among the ``expected`` names of ``what``."""
    names = ", ".join(str(name) for name in expected)
    return StictionError(
        f"unknown {what} {value!r}: expected {'one of ' if names else 'none'}{names}"
    )


def missing_extra(what: str, package: str, extra: str) -> StictionError:
    """Error for ``what`` needs a ``package`` that only an ``extra`` installs."""
    return StictionError(f"{what} needs {package}: pip install 'stiction-envs[{extra}]'")


@contextmanager
def opening(path: str | os.PathLike[str], expected: str) -> Iterator[None]:
    """Raise a StictionError in place of the OSError of a file that cannot be opened or read."""
    try:
        yield
    except OSError as error:
        reason = (error.strerror or str(error) or "cannot be read").lower()
        raise StictionError(f"{os.fspath(path)}: {reason}: expected {expected}") from None
