"""Report texts: Jinja2 templates in the ``templates`` folder of the package that fills them.

A template holds the words and a few branches. Numbers come from Python, either as text or through
`FILTERS`. Tables are made by `markdown.table_text`.
"""

import re
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from stiction_envs.reporting import markdown
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.html import to_html

FILTERS = ("number", "short", "listed", "joints", "plural", "sentence")
"""Functions of `markdown` that templates know by name."""


@cache
def _environment(folder: Path) -> Environment:
    out = Environment(
        loader=FileSystemLoader(folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # the pages are Markdown
    )
    for name in FILTERS:
        out.filters[name] = getattr(markdown, name)
    return out


def render(template: Path, /, **values: object) -> str:
    """Return the text of a template: no blank lines but single ones, one line end at the end.

    A value that the template asks for and that is missing is an error.
    """
    text = _environment(template.parent).get_template(template.name).render(**values)
    return re.sub(r"\n{3,}", "\n\n", re.sub(r"[ \t]+\n", "\n", text)).strip() + "\n"


def write_md_and_html(
    folder: Path,
    template: Path,
    title: str,
    names: tuple[str, str] = ("report.md", "report.html"),
    /,
    *,
    note: str = "",
    **values: object,
) -> tuple[str, str]:
    """Write a template's text as Markdown and as one HTML file that includes its pictures.

    Args:
        folder: an existing one, with the pictures that the text shows.
        template: its path.
        title: of the HTML page.
        names: names of the two files, which are returned.
        note: a paragraph below the heading.
        values: values of the template.
    """
    text = render(template, **values)
    if note:
        heading, _, rest = text.partition("\n")
        text = f"{heading}\n\n> {note}\n{rest}"
    write_text_atomic(folder / names[0], text)
    write_text_atomic(folder / names[1], to_html(text.splitlines(), folder, title))
    return names
