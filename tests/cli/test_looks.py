"""Reports of every command that writes one, as Chromium shows them."""

from __future__ import annotations

import pytest

from tests.browser import WIDTHS, wrong
from tests.cli.short_commands import QUICK, SLOW

pytestmark = pytest.mark.slow
REPORTING = ("identify", "sje", "gte", "diagnose", "tune", "search", "train")
COMMANDS = QUICK | SLOW


@pytest.mark.parametrize("name", REPORTING)
def test_a_report_can_be_read_on_a_desk_and_on_a_phone(run_short, work, chromium, name):
    assert run_short(COMMANDS[name], "here").code == 0
    pages = list((work / "here").rglob("*.html"))
    assert pages
    for page in pages:
        for width in WIDTHS:
            assert not wrong(chromium, page, width), (page.name, width)
