"""The browser tests find defects of a page."""

import pytest

from tests.browser import WIDTHS, wrong

pytestmark = pytest.mark.slow
WIDE, PHONE = WIDTHS


@pytest.mark.parametrize(
    ("body", "found"),
    [
        ('<img src="none.png" alt="arm">', "shows no picture: arm"),
        ('<img src="http://example.org/a.png">', "asks for http://example.org/a.png"),
        ('<script>fetch("https://example.org/b")</script>', "asks for https://example.org/b"),
        ("<script>none()</script>", "error: none is not defined"),
        ('<div style="width:600px">text</div>', "is 218 px too wide"),
    ],
)
def test_what_is_wrong_is_found(tmp_path, chromium, body, found):
    page = tmp_path / "a.html"
    page.write_text(f'<meta name="viewport" content="width=device-width"><body>{body}')
    assert found in wrong(chromium, page, PHONE)
    page.write_text("<body>text")
    assert not wrong(chromium, page, PHONE)
    assert not wrong(chromium, page, WIDE)
