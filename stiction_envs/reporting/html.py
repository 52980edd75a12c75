"""The report's Markdown as one HTML file that needs nothing else: pictures are in it."""

from __future__ import annotations

import base64
import html
import re
from pathlib import Path

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;color:#222}
h1{font-size:1.7em}h2{margin-top:2em;border-bottom:1px solid #ddd;padding-bottom:.2em}
img{max-width:100%;border:1px solid #eee}
figure{margin:1em 0;overflow-x:auto}a{color:#1f5fa8}td a{white-space:nowrap}
table{border-collapse:collapse;margin:1em 0;font-size:.9em;display:block;overflow-x:auto}
th,td{border:1px solid #ddd;padding:.25em .6em;text-align:left}th{background:#f6f6f6}
code{background:#f3f3f3;padding:0 .2em;overflow-wrap:anywhere}
@media(max-width:600px){body{margin:1em auto}img{max-width:none;width:620px}}
"""
_IMAGE = re.compile(r"^!\[(.*)\]\((\S+)\)$")
_ANCHOR = re.compile(r'^<a id="[a-z0-9-]+"></a>$')
_LINK = re.compile(r"\[([^\]]+)\]\(([^()\s]+)\)")


def to_html(lines: list[str], folder: Path, title: str) -> str:
    """Return a page of the Markdown that `report` writes.

    Headings, paragraphs, lists, tables, pictures, links, bold, italics and code, anchors that stand
    alone on their line; nothing else is known. Headings have the anchors that GitHub gives them.

    Args:
        lines: of Markdown.
        folder: where the pictures are.
        title: of the page.
    """
    out: list[str] = []
    k = 0
    while k < len(lines):
        text = lines[k]
        image = _IMAGE.match(text)
        if not text.strip():
            k += 1
        elif text.startswith("#"):
            level = len(text) - len(text.lstrip("#"))
            words = text[level:].strip()
            anchor = "" if level == 1 else f' id="{slug(words)}"'
            out.append(f"<h{level}{anchor}>{_inline(words)}</h{level}>")
            k += 1
        elif _ANCHOR.match(text):
            out.append(text)
            k += 1
        elif image:
            data = base64.b64encode((folder / image[2]).read_bytes()).decode()
            alt = html.escape(image[1], quote=True)
            out.append(f'<figure><img alt="{alt}" src="data:image/png;base64,{data}"></figure>')
            k += 1
        elif text.startswith("|"):
            k = _table(lines, k, out)
        elif text.startswith("- "):
            out.append("<ul>")
            while k < len(lines) and lines[k].startswith("- "):
                out.append(f"<li>{_inline(lines[k][2:])}</li>")
                k += 1
            out.append("</ul>")
        else:
            paragraph = []
            while k < len(lines) and lines[k].strip() and lines[k][0] not in "#|!":
                paragraph.append(lines[k])
                k += 1
            out.append(f"<p>{_inline(' '.join(paragraph))}</p>" if paragraph else "")
            k += not paragraph
    body = "\n".join(out)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width,initial-scale=1"><title>'
        f"{html.escape(title)}</title><style>{_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def slug(words: str) -> str:
    """Return the anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")


def _table(lines: list[str], k: int, out: list[str]) -> int:
    def cells(text: str) -> list[str]:
        return [c.strip() for c in text.strip().strip("|").split("|")]

    out.append("<table><tr>" + "".join(f"<th>{_inline(c)}</th>" for c in cells(lines[k])) + "</tr>")
    k += 2
    while k < len(lines) and lines[k].startswith("|"):
        out.append("<tr>" + "".join(f"<td>{_inline(c)}</td>" for c in cells(lines[k])) + "</tr>")
        k += 1
    out.append("</table>")
    return k


def _inline(text: str) -> str:
    text = html.escape(text, quote=False)
    text = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", text)
    text = re.sub(r"(?<![\w*])\*([^*\s](?:[^*]*[^*\s])?)\*(?![\w*])", r"<em>\1</em>", text)
    text = re.sub(r"`(.+?)`", r"<code>\1</code>", text)
    return _LINK.sub(r'<a href="\2">\1</a>', text)
