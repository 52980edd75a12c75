"""Templates: what they ask for must be there, and blank lines do not pile up."""

import pytest
from jinja2 import UndefinedError

from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.templates import render, write_md_and_html


@pytest.fixture
def template(tmp_path):
    path = tmp_path / "page.md.j2"
    path.write_text(
        "# {{ title }}\n\n{% if False %}\nno\n{% endif %}\n\n{{ x|number(2) }} < 1 & "
        "{{ js|joints }}  \n\n{{ rows }}\n\n\n"
    )
    return path


def test_page(template):
    rows = table_text(["a", "b"], [["1", "2"]])
    written = render(template, title="T", x=-0.5, js=[1, 2], rows=rows)
    assert written == "# T\n\n−0.50 < 1 & joints 1 and 2\n\n| a | b |\n|---|---|\n| 1 | 2 |\n"


def test_a_missing_number_is_an_error(template):
    with pytest.raises(UndefinedError, match="title"):
        render(template, x=1.0, js=[], rows="")


def test_a_note_stands_under_the_heading_of_both_pages(template, tmp_path):
    values = {"x": 1.0, "js": [1], "rows": ""}
    names = write_md_and_html(tmp_path, template, "Page", note="Mind the gap.", **values, title="T")
    assert names == ("report.md", "report.html")
    text = (tmp_path / "report.md").read_text("utf-8")
    assert text.startswith("# T\n\n> Mind the gap.\n\n1.00 < 1")
    assert "<blockquote>\n<p>Mind the gap.</p>" in (tmp_path / "report.html").read_text("utf-8")
