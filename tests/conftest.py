"""Order of the test files, and a cache of simulated results beside pytest's own."""

import os
from pathlib import Path

import pytest

from tests.browser import chromium  # noqa: F401
from tests.command_line import cli, dither, inputs, refused, two, work  # noqa: F401

HERE = Path(__file__).parent
# never stale, so that workers and runs may share it; the user's own stays as it is
os.environ.setdefault("STICTION_CACHE", str(HERE.parent / ".pytest_cache" / "stiction-envs"))
LONGEST = (
    "test_readme.py",
    "gap/tables/test_table_diagnosis.py",
    "gap/test_diagnosis.py",
    # after README's `make tune`, whose simulations it finds in the cache
    "docs/test_pages.py",
    # it mostly waits, while a page's commands take both processors
    "tuning/study/test_workers.py",
    "hidden/rehearsal/test_rehearse.py",
    "gap/test_hidden_causes.py",
    "gap/test_cases.py",
    "other_arms/test_logs.py",
    "experiments/sje/test_calibrate.py",
    "tuning/protocol/test_protocol.py",
    "cli/test_gte.py",
    "cli/test_diagnose.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the longest files first: a worker takes whole files, and the last one must be short."""
    place = {HERE / name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path, len(LONGEST)))
