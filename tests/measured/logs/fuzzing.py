"""Damaged logs: each is read whole, or refused in one line."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from stiction_envs.errors import StictionError
from stiction_envs.measured.logs.robot_log import RobotLog

CELLS = st.one_of(
    st.floats(width=32).map(repr),
    st.integers(-3, 3).map(str),
    st.sampled_from(["", "nan", "inf", "-1e999", "1_0", "0x1", "a", '"', " ", "\0", "é", "1e300"]),
)


def fuzz(examples: int) -> settings:
    return settings(
        max_examples=examples,
        deadline=5000,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )


def put(path: Path, text: str | bytes) -> Path:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def reads_or_complains(read: Callable[[], RobotLog]) -> None:
    """Assert that a log is read into finite numbers and a rising time, or refused in one line."""
    message = ""
    try:
        log = read()
    except StictionError as error:
        message = str(error)
    else:
        assert np.all(np.diff(log.t) > 0)
        assert all(np.isfinite(x).all() for x in log.arrays if x is not None)
    assert "\n" not in message


def refuses(read: Callable[[], object], says: str) -> str:
    """Return the one line that refuses a file, with the pattern ``says`` and what is expected."""
    with pytest.raises(StictionError) as error:
        read()
    message = str(error.value)
    assert re.search(says, message), message
    assert "expected" in message
    assert "\n" not in message
    return message


def damaged(data: st.DataObject, raw: bytes, *, least: int = 0, most: int) -> bytes:
    """Return ``raw`` with ``least`` to ``most`` bytes replaced by drawn ones."""
    out = bytearray(raw)
    for _ in range(data.draw(st.integers(least, most))):
        out[data.draw(st.integers(0, len(out) - 1))] = data.draw(st.integers(0, 255))
    return bytes(out)
