"""Numbers, lists and tables as text for reports."""

import math
from collections.abc import Iterable, Sequence


def number(value: float, digits: int = 1) -> str:
    """Return a number with a true minus and no −0.0; – for NaN."""
    return signed(value, digits).removeprefix("+")


def signed(value: float, digits: int = 1) -> str:
    """Return a number with its sign, a true minus, and no −0.0; – for NaN."""
    if math.isnan(value):
        return "–"
    text = f"{value:+.{digits}f}"
    if not float(text):
        text = text[1:]
    return text.replace("-", "−")


def percent(value: float, digits: int = 1) -> str:
    """Return a signed percentage; ``value`` is in per cent already."""
    return f"{signed(value, digits)} %"


def short(value: float, figures: int = 3) -> str:
    """Return a number of any size with some figures, without an exponent; – for NaN."""
    if math.isnan(value):
        return "–"
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    digits = max(0, figures - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}".replace("-", "−")


def span(values: Iterable[float], figures: int = 2, unit: str = "") -> str:
    """Return ``0.2 to 0.7`` from least and largest, one number where both read the same."""
    ordered = sorted(values)
    ends = dict.fromkeys(short(x, figures) for x in (ordered[0], ordered[-1]))
    return " to ".join(ends) + (f" {unit}" if unit else "")


def listed(items: Iterable[object]) -> str:
    """Return ``1, 2 and 3``."""
    texts = [str(x) for x in items]
    if len(texts) < 2:
        return "".join(texts)
    return ", ".join(texts[:-1]) + " and " + texts[-1]


def joints(numbers: Sequence[int]) -> str:
    """Return ``joint 1`` or ``joints 1, 2 and 3``; ``no joint``."""
    if not numbers:
        return "no joint"
    return ("joints " if len(numbers) > 1 else "joint ") + listed(numbers)


def plural(count: int, noun: str) -> str:
    """Return ``1 cell`` or ``2 cells``."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def sentence(text: str) -> str:
    """Return a clause with a capital letter and a full stop."""
    text = text[:1].upper() + text[1:]
    return text if text.endswith(".") else text + "."


def table_text(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table with a line end; a "|" in a cell is escaped."""

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(x.replace("|", "\\|") for x in cells) + " |"

    return "\n".join([line(header), "|" + "---|" * len(header), *map(line, rows), ""])


def aligned(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table for a terminal: the first column to the left, the others to the right."""
    lines = [header, *rows]
    width = [max(map(len, column)) for column in zip(*lines, strict=True)]
    cells = ([x.rjust(w) for x, w in zip(line, width, strict=True)] for line in lines)
    texts = [line[0].ljust(width[0]) for line in lines]
    return "\n".join("  ".join([x, *c[1:]]).rstrip() for x, c in zip(texts, cells, strict=True))
