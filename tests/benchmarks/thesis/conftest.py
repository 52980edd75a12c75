from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest

from benchmarks.thesis import command
from tests.command_line import Ran


@pytest.fixture
def thesis(cli) -> Callable[..., Ran]:
    """Run `python -m benchmarks.thesis` in the working folder."""
    return partial(cli, "reproduce", commands=[command])
