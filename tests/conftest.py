"""Order of the test files."""

from __future__ import annotations

import pytest

LONGEST = "test_readme.py"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the longest file first: a worker takes whole files, and the last one must be short."""
    items.sort(key=lambda item: item.path.name != LONGEST)
