"""The C library's heap keeps what large arrays leave behind."""

from __future__ import annotations

import ctypes
import sys


def trim() -> None:
    """Give the heap's free pages back to the system, where the C library is glibc.

    Arrays of some megabytes that come and go leave holes between those that stay, a tenth of a
    diagnosis' memory.
    """
    if sys.platform == "linux":
        give_back = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if give_back is not None:
            give_back(0)
