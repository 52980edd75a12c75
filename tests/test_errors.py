"""Errors are one family, and those of the library speak of arguments, not of options."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from stiction_envs.errors import ExperimentError, StictionError

ROOT = Path(__file__).parents[1]
COMMANDS = ("stiction_envs/cli", "tuning/commands")
OPTION = re.compile(r"(?<![`\w-])--[a-z]")


def test_one_exception_catches_all():
    assert issubclass(ExperimentError, StictionError)


def texts_raised(path: Path) -> list[str]:
    """Return the literal parts of all that a file raises."""
    raised = [n for n in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(n, ast.Raise)]
    parts = [x for node in raised for x in ast.walk(node) if isinstance(x, ast.Constant)]
    return [x.value for x in parts if isinstance(x.value, str)]


def test_no_error_of_the_library_speaks_of_an_option():
    found = [
        f"{path.relative_to(ROOT)}: {text}"
        for top in ("stiction_envs", "tuning")
        for path in (ROOT / top).rglob("*.py")
        if not str(path.relative_to(ROOT)).startswith(COMMANDS)
        for text in texts_raised(path)
        if OPTION.search(text)
    ]
    assert found == []
