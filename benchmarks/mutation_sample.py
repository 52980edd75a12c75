"""The faults of `mutation`: every mutant of a room's sources, and a fixed random sample of them."""

from __future__ import annotations

import ast
import hashlib
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
GAP = ("candidates", "estimates", "normal_equations", "selection")
ROOMS: dict[str, tuple[int, tuple[str, ...], tuple[str, ...]]] = {
    # mutants, sources, tests
    "friction": (
        100,
        ("stiction_envs/friction/*.py",),
        (
            "tests/friction",
            "tests/test_plant.py",
            "tests/test_plant_determinism.py",
            "tests/cli/test_export.py",
            "tests/experiments/test_conformance.py",
            "tests/experiments/sje",
        ),
    ),
    "control": (
        100,
        ("stiction_envs/control/*.py",),
        (
            "tests/control",
            "tests/experiments/gte",
            "tests/envs/test_gte.py",
            "tests/cli/test_gte.py",
        ),
    ),
    "gap": (
        120,
        tuple(f"stiction_envs/gap/{name}.py" for name in GAP),
        ("tests/gap", "tests/cli/test_diagnose.py"),
    ),
}
SEED = 12
OPERATORS = (
    *("AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr"),
    *("ReplaceOrWithAnd", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak"),
    *("NumberReplacer", "ZeroIterationForLoop"),
    *(f"ReplaceUnaryOperator_{x}" for x in ("USub_UAdd", "Delete_Not", "Delete_Invert")),
    *(
        f"ReplaceComparisonOperator_{x}"
        for x in (
            *("Eq_NotEq", "NotEq_Eq", "Is_IsNot", "IsNot_Is", "Lt_LtE", "Lt_GtE"),
            *("LtE_Lt", "LtE_Gt", "Gt_GtE", "Gt_LtE", "GtE_Gt", "GtE_Lt"),
        )
    ),
    *(
        f"ReplaceBinaryOperator_{x}"
        for x in (
            *("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul", "FloorDiv_Mul"),
            *("Mod_Mul", "BitAnd_BitOr", "BitOr_BitAnd"),
        )
    ),
)
"""Of cosmic-ray's, those that make sense of numbers: any test notices a shifted float."""


@dataclass(frozen=True)
class Mutant:
    """One fault: which file, which line, how it read and how it reads, the whole mutated text."""

    room: str
    file: str
    line: int
    operator: str
    was: str
    is_now: str
    text: str

    @property
    def name(self) -> str:
        return f"{self.file}:{self.line} `{self.was}` → `{self.is_now}`"


def operators() -> dict[str, Any]:
    """Return instances of `OPERATORS`, and one that removes a statement's work."""
    from cosmic_ray.operators.operator import Operator
    from cosmic_ray.plugins import get_operator
    from parso.python.tree import Keyword

    class RemoveStatement(Operator):
        """``return x`` becomes ``return None``; a raise, call or write into something, ``pass``.

        The first assignment to a plain name stays: without it any test ends in a NameError.
        """

        def mutation_positions(self, node):
            kind = node.type
            written = kind == "expr_stmt" and (
                node.children[0].type != "name" or (node.children[1].type == "operator"
                and node.children[1].value not in ("=", ":"))
            )  # fmt: skip
            called = kind in ("atom_expr", "power") and node.parent.type == "simple_stmt"
            if written or called or kind == "raise_stmt" or kind == "return_stmt":
                yield node.start_pos, node.end_pos

        def mutate(self, node, index):
            new = "return None" if node.type == "return_stmt" else "pass"
            return Keyword(new, node.start_pos, node.get_first_leaf().prefix)

        @classmethod
        def examples(cls):
            return ()

    made = {name: get_operator(f"core/{name}")() for name in OPERATORS}
    return {**made, "RemoveStatement": RemoveStatement()}


def without_annotations(code: str) -> str:
    """Return a module's syntax tree as text; what only a type checker reads is left out."""
    tree = ast.parse(code)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            node.returns = None
        elif isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(None)
        elif isinstance(node, ast.arguments):  # a bare * that became / asks for nothing else
            node.args, node.posonlyargs = node.posonlyargs + node.args, []
            node.args, node.kwonlyargs = node.args + node.kwonlyargs, []
            node.defaults, node.kw_defaults = node.defaults + node.kw_defaults, []
    return ast.dump(tree)


def sources(room: str) -> dict[Path, str]:
    """Return the texts of the files that a room's mutants come from."""
    return {p: p.read_text("utf-8") for x in ROOMS[room][1] for p in sorted(ROOT.glob(x))}


def digest(room: str) -> str:
    """Return what tells whether a room's sources have changed since its sample was drawn."""
    return hashlib.sha256("".join(sources(room).values()).encode()).hexdigest()


def drawn(room: str) -> list[Mutant]:
    """Return some of a room's mutants, drawn from all of them; what is none is passed over."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code

    texts = sources(room)
    places = [
        (path, name, operator, occurrence, start[0])
        for path in sorted(texts)
        for name, operator in operators().items()
        for occurrence, (start, _) in enumerate(
            x for n in ast_nodes(get_ast(texts[path])) for x in operator.mutation_positions(n)
        )
    ]
    random.Random(SEED).shuffle(places)
    out: list[Mutant] = []
    for path, name, operator, occurrence, line in places:
        text = mutate_code(texts[path], operator, occurrence)
        try:
            if without_annotations(text) == without_annotations(texts[path]):
                continue
        except SyntaxError:
            continue
        was, now = (t.splitlines()[line - 1].strip() for t in (texts[path], text))
        out.append(Mutant(room, str(path.relative_to(ROOT)), line, name, was, now, text))
        if len(out) == ROOMS[room][0]:
            break
    return sorted(out, key=lambda m: (m.file, m.line, m.operator, m.is_now))
