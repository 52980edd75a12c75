"""Free pages of the heap go back to the system."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

import pytest

from stiction_envs.gap.selection import heap


def resident() -> int:
    """Return the memory of this process that is in use [kB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(x for x in lines if x.startswith("VmRSS")).split()[1])


@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="no glibc"
)
def test_holes_between_what_stays_are_given_back():
    pieces = [bytearray(b"x" * 100_000) for _ in range(1000)]  # too small for pages of their own
    stay = pieces[::100]
    del pieces
    before = resident()
    heap.trim()
    assert before - resident() > 50_000
    assert len(stay) == 10
