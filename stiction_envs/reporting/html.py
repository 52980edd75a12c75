"""A report's Markdown as one HTML file that includes its pictures."""

import base64
import html
import re
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import unquote

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token
from markdown_it.utils import EnvType as Env
from markdown_it.utils import OptionsDict as Options

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;color:#222}
h1{font-size:1.7em}h2{margin-top:2em;border-bottom:1px solid #ddd;padding-bottom:.2em}
img{max-width:100%;box-sizing:border-box;border:1px solid #eee}
p:has(>img){overflow-x:auto}
blockquote{margin:1em 0;padding:0 1em;border-left:3px solid #ccc}
a{color:#1f5fa8}td a{white-space:nowrap}
table{border-collapse:collapse;margin:1em 0;font-size:.9em;display:block;overflow-x:auto}
th,td{border:1px solid #ddd;padding:.25em .6em;text-align:left}th{background:#f6f6f6}
code{background:#f3f3f3;padding:0 .2em;overflow-wrap:anywhere}
@media(max-width:600px){body{margin:1em auto}img{max-width:none;width:620px}}
"""


def to_html(lines: Sequence[str], folder: Path, title: str) -> str:
    """Return a page of a report's Markdown (CommonMark with tables).

    The page includes the pictures that are below the folder; other image links stay text. Headings
    have GitHub's anchors. HTML, which a report may quote from names in a file, is escaped.
    """
    body = _MARKDOWN.render("\n".join(lines), {"folder": folder})
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width,initial-scale=1"><title>'
        f"{html.escape(title)}</title><style>{_STYLE}</style></head>\n<body>\n{body}</body></html>\n"
    )


def slug(words: str) -> str:
    """Return the anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")


class _Renderer(RendererHTML):
    """CommonMark, with anchors of headings and included pictures."""

    def heading_open(self, tokens: Sequence[Token], k: int, options: Options, env: Env) -> str:
        if tokens[k].tag != "h1":
            words = "".join(t.content for t in tokens[k + 1].children or ())
            tokens[k].attrSet("id", slug(words))
        return self.renderToken(tokens, k, options, env)

    def image(self, tokens: Sequence[Token], k: int, options: Options, env: Env) -> str:
        path, alt = _picture(tokens[k], env["folder"]), html.escape(tokens[k].content, quote=True)
        if path is None:
            return html.escape(f"![{tokens[k].content}]({tokens[k].attrs['src']})")
        data = base64.b64encode(path.read_bytes()).decode()
        return f'<img alt="{alt}" src="data:image/png;base64,{data}">'


def _picture(token: Token, folder: Path) -> Path | None:
    """Return the picture of an image; None where it is missing or not below the folder."""
    path = (folder / unquote(str(token.attrs["src"]))).resolve()
    ours = path.is_relative_to(folder.resolve()) and path.suffix == ".png"
    return path if ours and path.is_file() else None


_MARKDOWN = MarkdownIt("commonmark", {"html": False}, renderer_cls=_Renderer).enable("table")
