"""The one exception a user of the package has to know."""

from __future__ import annotations

from collections.abc import Iterable


class StictionError(ValueError):
    """Bad input: the message is one line and says what, where, and what is allowed.

    The command line turns it into exit code 2; nothing has been written when it is raised.
    """


class ExperimentError(RuntimeError):
    """The input was fine, but the simulated experiment failed: exit code 1.

    An arm that cannot be held in its pose, a joint that sticks, a calibration that does not
    converge. The message is one line.
    """


def unknown(what: str, value: object, allowed: Iterable[object]) -> StictionError:
    """Error for a ``value`` that is not among the ``allowed`` names of ``what``."""
    names = ", ".join(str(a) for a in allowed)
    return StictionError(f"unknown {what} {value!r}: allowed are {names}")
