"""Errors of the package: `StictionError`, of which `ExperimentError` is one kind."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


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
    """Return the error for a ``value`` that is not an ``expected`` name of ``what``."""
    names = ", ".join(str(name) for name in expected)
    return StictionError(
        f"unknown {what} {value!r}: expected {'one of ' if names else 'none'}{names}"
    )


def missing_extra(what: str, package: str, extra: str) -> StictionError:
    """Return the error that ``what`` needs a ``package`` of an ``extra``."""
    return StictionError(f"{what} needs {package}: pip install 'stiction-envs[{extra}]'")


@contextmanager
def opening(path: str | os.PathLike[str], expected: str) -> Iterator[None]:
    """Raise a StictionError in place of the OSError of a file that cannot be opened or read."""
    try:
        yield
    except OSError as error:
        reason = (error.strerror or str(error) or "cannot be read").lower()
        raise StictionError(f"{os.fspath(path)}: {reason}: expected {expected}") from None


def checked_array(
    value: object,
    what: str,
    shape: tuple[int, ...] | None = None,
    *,
    expected: str = "",
    fill: bool = False,
    finite: bool = True,
    low: float = -math.inf,
    above: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
) -> NDArray[np.float64]:
    """Return numbers as a new float64 array in C order: the check of all numbers from outside.

    Text of tables becomes numbers in `csv_text.Line`, that of options in `cli.common.number`;
    settings are checked by `method_settings`.

    Args:
        value: the numbers, as a caller or a file gives them.
        what: name of the numbers, for the message.
        shape: shape that they must have; None for any.
        expected: text of the message; "" for finite numbers of that shape and range.
        fill: whether numbers of another shape are broadcast.
        finite: whether inf and NaN are refused; NaN is in no range.
        low: least number.
        above: number that all others must be above.
        high: largest number.
        unit: for the message.
    """
    import numpy as np  # the commands' help does without

    def refuse(found: str) -> StictionError:
        words = "finite numbers" if finite else "numbers"
        if shape is not None:
            words += f" of shape {shape}" if shape else ", one"
        for word, bound in (("from", low), ("above", above), ("to", high)):
            words += f" {word} {bound:g}" if math.isfinite(bound) else ""
        words += f" {unit}" if unit not in ("", "1") else ""
        return StictionError(f"{what} {found}: expected {expected or words}")

    try:
        out = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        raise refuse(f"is a {type(value).__name__}") from None
    if shape is not None and out.shape != shape:
        try:
            filled = np.broadcast_to(out, shape if fill else out.shape)
        except ValueError:
            filled = out
        if filled.shape != shape:
            raise refuse(f"has shape {out.shape}")
        out = filled.copy(order="C")
    if finite and not np.isfinite(out).all():
        raise refuse(f"is {out[~np.isfinite(out)].flat[0]}")
    inside = (out >= low) & (out > above) & (out <= high)
    if (low, above, high) != (-math.inf, -math.inf, math.inf) and not inside.all():
        raise refuse(f"is {out[~inside].flat[0]:g}")
    return out
