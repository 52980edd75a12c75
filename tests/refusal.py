"""Bad input is refused in one line."""

import re
from collections.abc import Callable

import pytest

from stiction_envs.errors import StictionError


def refusal(act: Callable[[], object], says: str = "") -> str:
    """Return the one line by which an act is refused; it has the pattern ``says``."""
    with pytest.raises(StictionError) as error:
        act()
    line = str(error.value)
    assert "\n" not in line
    assert re.search(says, line), line
    return line
