"""The rooms of ARCHITECTURE.md: imports run one way, and no two files need each other."""

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.command_line import ROOT

FLOW = (
    ("stiction_envs.arrays",),
    (
        "stiction_envs.errors",
        "stiction_envs.compiled",
        "stiction_envs.version",
    ),
    ("stiction_envs.method_settings", "stiction_envs.filters"),
    ("stiction_envs.reporting",),
    ("stiction_envs.precomputed",),
    ("stiction_envs.robots", "stiction_envs.dither"),
    ("stiction_envs.measured",),
    ("stiction_envs.friction",),
    ("stiction_envs.plant",),
    ("stiction_envs.control",),
    ("stiction_envs.experiments",),
    ("stiction_envs.gap",),
    ("stiction_envs.identification",),
    ("stiction_envs.envs", "stiction_envs.hidden"),
    ("stiction_envs.cli",),
    ("tuning",),
    ("benchmarks",),
    ("tests",),
)
"""Rooms from the ground up: a file imports from its own room and from those above it in this list.

Rooms in one row know nothing of each other.
"""
FACADE = "stiction_envs"
"""Hands names on to users and registers environments; the library itself never asks it."""
FACADE_FOR = ("stiction_envs.cli", "tuning.commands", "benchmarks", "tests")


def sources() -> dict[str, Path]:
    """Return every module of the project by its name."""
    out = {}
    for top in ("stiction_envs", "tuning", "benchmarks", "tests"):
        for path in (ROOT / top).rglob("*.py"):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            out[name.removesuffix(".__init__")] = path
    return out


SOURCES = sources()


def imported(name: str) -> set[str]:
    """Return the project's modules that a module imports anywhere, for types too."""
    out: set[str] = set()
    for node in ast.walk(ast.parse(SOURCES[name].read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import"
            found = [f"{node.module}.{a.name}" for a in node.names]
            out |= {x if x in SOURCES else str(node.module) for x in found}
        elif isinstance(node, ast.Import):
            out |= {a.name for a in node.names}
    return {x for x in out if x in SOURCES and x != name}


@cache
def imports() -> dict[str, set[str]]:
    """Return what every module imports; read when a test asks, not by every worker."""
    return {name: imported(name) for name in SOURCES}


def room(name: str) -> int | None:
    """Return the row of a module's room; None for the facade."""
    for row, rooms in enumerate(FLOW):
        if any(name == x or name.startswith(f"{x}.") for x in rooms):
            return row
    assert name == FACADE, f"{name} is in no room"
    return None


def same_room(one: str, other: str) -> bool:
    """Return whether two modules are in one room, not only in one row."""
    return any(
        all(x == r or x.startswith(f"{r}.") for x in (one, other)) for row in FLOW for r in row
    )


def against_the_flow(name: str, target: str) -> bool:
    """Return whether an import runs up, or to a neighbour."""
    if target == FACADE:
        return name != FACADE and not name.startswith(FACADE_FOR)
    here, there = room(name), room(target)
    if here is None or there is None:
        return False
    return there > here or (there == here and not same_room(name, target))


def test_imports_run_one_way():
    every = imports()
    found = [f"{a} -> {b}" for a in every for b in sorted(every[a]) if against_the_flow(a, b)]
    assert found == []


def test_no_files_need_each_other():
    """The error names a circle of modules; packages' faces are left out."""
    faces = {n for n, p in SOURCES.items() if p.name == "__init__.py"}
    TopologicalSorter({n: imports()[n] - faces for n in SOURCES if n not in faces}).prepare()


@pytest.mark.parametrize(
    ("name", "target", "wrong"),
    [
        ("stiction_envs.gap.extended_model", "stiction_envs.cli.common", True),
        ("benchmarks.accuracy.blind_logs", "tests.gap.small_logs", True),
        ("stiction_envs.cli.sje", "tuning.protocol.tune", True),
        ("stiction_envs.plant", "stiction_envs", True),
        ("stiction_envs.cli.sje", "stiction_envs.experiments.sje.experiment", False),
        ("stiction_envs.gap.causes.body.payload", "stiction_envs.gap.signals.dataset", False),
    ],
)
def test_the_rule_tells_right_from_wrong(name, target, wrong):
    assert against_the_flow(name, target) is wrong


# ---- errors are one family, and those of the library speak of arguments, not of options ----------

COMMANDS = ("stiction_envs/cli", "tuning/commands")
OPTION = re.compile(r"(?<![`\w-])--[a-z]")


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
