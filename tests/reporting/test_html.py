"""A page of Markdown as one HTML file."""

from stiction_envs.reporting.html import to_html


def test_html_escapes_and_holds_its_pictures(tmp_path):
    (tmp_path / "a.png").write_bytes(b"png")
    lines = ["# A < B", "", "text **bold** `x<y`", "more", "", "- one", "- two", ""]
    lines += ["| a | b |", "|---|---|", "| 1 | 2 |", "", "![pic](a.png)", "", "!odd"]
    page = to_html(lines, tmp_path, "T & T")
    for part in (
        "<title>T &amp; T</title>",
        "<h1>A &lt; B</h1>",
        "<strong>bold</strong> <code>x&lt;y</code> more",
        "<li>one</li>\n<li>two</li>",
        "<td>1</td><td>2</td>",
        'src="data:image/png;base64,cG5n"',
    ):
        assert part in page
