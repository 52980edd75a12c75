from collections.abc import Callable
from pathlib import Path

import pytest

from tests.measured.logs.ros_bags import Message, merged, write_bag


@pytest.fixture
def bag(tmp_path: Path) -> Callable[..., Path]:
    """Write a bag of some streams of messages."""

    def write(*streams: list[Message], kind: str = "mcap", name: str = "log", **silent) -> Path:
        return write_bag(tmp_path / name, kind, merged(*streams), **silent)

    return write
