"""Templates: what they ask for must be there, and blank lines do not pile up."""

from __future__ import annotations

import pytest
from jinja2 import UndefinedError

from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.templates import render, write_page


@pytest.fixture
def template(tmp_path):
    path = tmp_path / "page.md.j2"
    path.write_text(
        "# {{ title }}\n\n{% if False %}\nno\n{% endif %}\n\n{{ x|signed(2) }} < 1 & "
        "{{ js|joints }}  \n\n{{ rows }}\n\n\n"
    )
    return path


def test_page(template, tmp_path):
    rows = table_text(["a", "b"], [["1", "2"]])
    written = write_page(tmp_path / "page.md", template, title="T", x=-0.5, js=[1, 2], rows=rows)
    assert (tmp_path / "page.md").read_text("utf-8") == written
    assert written == "# T\n\n−0.50 < 1 & joints 1 and 2\n\n| a | b |\n|---|---|\n| 1 | 2 |\n"


def test_a_missing_number_is_an_error(template):
    with pytest.raises(UndefinedError, match="title"):
        render(template, x=1.0, js=[], rows="")
