"""The only writer of TOML: tomli-w's text, with comments and with arrays of numbers on one line."""

import re
from collections.abc import Mapping

import tomli_w

_NUMBERS = re.compile(r"= (\[\n[^\"={}]*?\n\])$", re.MULTILINE)
"""An array without texts or tables, as tomli-w spreads it over lines."""


def toml_text(
    table: Mapping[str, object], *, head: str = "", comments: Mapping[str, str] | None = None
) -> str:
    """Return TOML that `tomllib` reads back as it was: floats to the last bit, inf and NaN too.

    Args:
        table: nested tables of plain Python values, without None.
        head: comment at the top, without ``#``.
        comments: comments above tables, by top-level name.
    """
    single: list[str] = []
    tables: list[str] = []
    for name, value in table.items():
        text = _NUMBERS.sub(_one_line, tomli_w.dumps({name: value}))
        # what follows a table's header would belong to that table
        (tables if text.startswith("[") else single).append(
            _comment((comments or {}).get(name, "")) + text
        )
    start = [_comment(head)] if head else []
    return "\n".join([*start, *(["".join(single)] if single else []), *tables])


def _comment(text: str) -> str:
    return "".join(f"# {line}\n" for line in text.splitlines())


def _one_line(found: re.Match[str]) -> str:
    joined = "".join(line.strip() + " " for line in found[1].splitlines())
    return "= " + joined.strip().replace("[ ", "[").replace(", ]", "]")
