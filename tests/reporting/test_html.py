"""A page of Markdown as one HTML file."""

from stiction_envs.reporting.html import slug, to_html


def test_html_escapes_and_holds_its_pictures(tmp_path):
    (tmp_path / "a.png").write_bytes(b"png")
    lines = ["# A < B", "", "text **bold** `x<y`", "more", "", "- one", "- two", ""]
    lines += ["| a | b |", "|---|---|", "| 1 | 2 |", "", "![pic](a.png)", "", "!odd"]
    page = to_html(lines, tmp_path, "T & T")
    for part in (
        "<title>T &amp; T</title>",
        "<h1>A &lt; B</h1>",
        "<strong>bold</strong> <code>x&lt;y</code>\nmore",
        "<li>one</li>\n<li>two</li>",
        "<td>1</td>\n<td>2</td>",
        'src="data:image/png;base64,cG5n"',
    ):
        assert part in page


def test_links_reach_headings(tmp_path):
    lines = ["## Table 4.6", "", "## Future work, and more", ""]
    lines += ["| a |", "|---|", "| [Table 4.6](#table-46) |", "", "see [numbers](tables/t.csv)"]
    page = to_html(lines, tmp_path, "T")
    assert '<h2 id="table-46">Table 4.6</h2>' in page
    assert '<td><a href="#table-46">Table 4.6</a></td>' in page
    assert '<p>see <a href="tables/t.csv">numbers</a></p>' in page
    assert slug("Future work, and more") == "future-work-and-more"
    assert slug("Joint 1 (+)") == "joint-1-"


def test_a_name_with_markup_stays_text(tmp_path):
    lines = [
        "log <script>alert(1)</script>.csv",
        "",
        "<b>block</b>",
        "",
        "<div onclick='alert(1)'>",
        "",
        "[x](javascript:alert(1))",
    ]
    page = to_html(lines, tmp_path, "T")
    body = page[page.index("<body>") :]
    assert "<script" not in body
    assert "<b>" not in body
    assert "<div" not in body
    assert 'href="javascript' not in body


def test_other_image_links_stay_text(tmp_path):
    """A joint of a URDF may be called anything: no other file of this machine is shown for it."""
    folder = tmp_path / "out"
    folder.mkdir()
    (tmp_path / "other.png").write_bytes(b"secret")
    (folder / "data.csv").write_bytes(b"secret")
    names = ("../other.png", str(tmp_path / "other.png"), "data.csv", "none.png", "https://a/b.png")
    for name in names:
        page = to_html([f"![a]({name}) says **b**"], folder, "T")
        assert "<img" not in page
        assert f"![a]({name}) says <strong>b</strong>" in page, name


def test_quotations_and_pictures_in_one_row(tmp_path):
    (tmp_path / "a.png").write_bytes(b"png")
    page = to_html(["> one", ">", "> two", "", "![a](a.png) ![b](a.png)"], tmp_path, "T")
    assert page.count("<blockquote>") == 1
    assert page.count("<img ") == 2
