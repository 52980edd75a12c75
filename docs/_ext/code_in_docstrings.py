"""Indented lines of a docstring are code or an equation: shown as they are written."""

from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, bool]:
    """Run before napoleon, which reads the sections."""
    app.connect("autodoc-process-docstring", mark, priority=100)
    return {"parallel_read_safe": True}


def mark(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Put `::` before each indented block that stands between empty lines."""
    out: list[str] = []
    for k, line in enumerate(lines):
        begins = line.startswith("    ") and k > 1 and not lines[k - 1].strip()
        before = next((x for x in reversed(lines[:k]) if x.strip()), "")
        if begins and before and not before.startswith(" ") and not before.endswith("::"):
            out += ["::", ""]
        out.append(line)
    lines[:] = out
