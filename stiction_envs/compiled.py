"""Functions compiled by numba where numpy would spend its time between calls on small arrays.

They compute in a fixed order, without `fastmath` and without threads: the same bits on any batch.
They release Python's global lock, so that callers may use threads.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar, cast

import numba

_njit: Any = numba.njit  # `_nrt` has no type
F = TypeVar("F", bound=Callable[..., Any])

Arguments = tuple[Any, ...]
"""Arguments of a compiled function in their order: arrays, numbers, and tuples of both."""


def compiled(function: F) -> F:
    """Compile a function on its first call, division by zero as in numpy; a decorator.

    The machine code is cached beside the source or in the user's cache. Where neither can be
    written, every process compiles again.
    """
    return _compile(function)


def inlined(function: F) -> F:
    """Compile a function that other compiled functions call in every control step.

    The function becomes part of its callers and counts no references, which saves some 10 ns for
    each array argument. The function must not make arrays: numba then refuses to compile it.
    """
    return _compile(function, forceinline=True, _nrt=False)


def as_c_function(signature: Any, function: Callable[..., Any]) -> Any:
    """Compile a function that other compiled functions know by its ``address`` only.

    They need not be compiled again for another function. The address is valid in this process, as
    long as the returned object lives.
    """
    return _cached(partial(numba.cfunc, signature), function, error_model="numpy")


def _compile(function: F, **options: Any) -> F:
    options = {"error_model": "numpy", "nogil": True} | options
    return cast(F, _cached(_njit, function, **options))


def _cached(decorator: Callable[..., Any], function: Callable[..., Any], **options: Any) -> Any:
    try:
        return decorator(cache=True, **options)(function)
    except RuntimeError:  # numba: no locator available
        return decorator(**options)(function)
