"""Functions compiled by numba where numpy would spend its time between calls on small arrays.

They compute in a fixed order, without `fastmath` and without threads: the same bits on any batch.
They release Python's global lock, so that callers may use threads.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

Arguments = tuple[Any, ...]
"""Arguments of a compiled function in their order: arrays, numbers, and tuples of both."""


def compiled(function: F) -> F:
    """Compile a function on its first call, division by zero as in numpy; a decorator.

    The machine code is cached beside the source or in the user's cache. Where neither can be
    written, every process compiles again.
    """
    try:
        return cast(F, numba.njit(cache=True, error_model="numpy", nogil=True)(function))
    except RuntimeError:  # numba: no locator available
        return cast(F, numba.njit(error_model="numpy", nogil=True)(function))
