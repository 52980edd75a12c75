"""Order of the test files."""

from __future__ import annotations

import pytest

LONGEST = ("test_readme.py", "test_calibrate.py", "test_table_causes.py", "test_diagnose.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the longest files first: a worker takes whole files, and the last one must be short."""
    place = {name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(LONGEST)))
