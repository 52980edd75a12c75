"""What the tests notice: small faults in the code, one at a time, each met by its room's tests.

    python -m benchmarks.mutation [--rooms friction] [--workers 2] [--work DIR]

Needs the extra ``mutation`` (cosmic-ray, whose operators make the faults). Of all faults of a room
a fixed sample is drawn. Each is put into a copy of the project and meets the quick tests of its own
module, then those of its room, until one fails. Rows are kept until the room's sources change:
changed tests need another ``--work``. ``mutation.toml`` says what we think of those that lived.
"""

from __future__ import annotations

import ast
import hashlib
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.harness import ROOT, Benchmark, Row, Rows
from stiction_envs.reporting.markdown import table_text

STUDY = Benchmark(__file__, __doc__)
GAP = ("estimates", "linear/*", "selection/*")
ROOMS: dict[str, tuple[int, tuple[str, ...], tuple[str, ...]]] = {
    # faults (assumed), sources, tests
    "friction": (
        100,
        ("stiction_envs/friction/*.py",),
        (
            *("tests/friction", "tests/plant"),
            *("tests/cli/test_export.py", "tests/experiments/test_conformance.py"),
            "tests/experiments/sje",
        ),
    ),
    "control": (
        100,
        ("stiction_envs/control/*.py",),
        (
            *("tests/control", "tests/experiments/gte", "tests/envs/test_gte.py"),
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
TIMES_NORMAL, START_S = 4, 30
"""A fault counts as noticed after so many times the processor time of the sound tests [-], and the
time to import and compile everything [s]; assumed."""
COMPARISONS = (
    *("Eq_NotEq", "NotEq_Eq", "Is_IsNot", "IsNot_Is", "Lt_LtE", "Lt_GtE", "LtE_Lt"),
    *("LtE_Gt", "Gt_GtE", "Gt_LtE", "GtE_Gt", "GtE_Lt"),
)
ARITHMETIC = (
    *("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul", "FloorDiv_Mul", "Mod_Mul"),
    *("BitAnd_BitOr", "BitOr_BitAnd"),
)
OPERATORS = (
    *("AddNot", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr"),
    *("ReplaceOrWithAnd", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak"),
    *("NumberReplacer", "ZeroIterationForLoop"),
    *(f"ReplaceUnaryOperator_{x}" for x in ("USub_UAdd", "Delete_Not", "Delete_Invert")),
    *(f"ReplaceComparisonOperator_{x}" for x in COMPARISONS),
    *(f"ReplaceBinaryOperator_{x}" for x in ARITHMETIC),
)
"""Of cosmic-ray's, those that make sense of numbers: any test notices a shifted float."""
COPIED = shutil.ignore_patterns(".git", ".venv", "runs", "shared", "__pycache__", ".*_cache")


# ---- faults --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Fault:
    """How a line read and how it reads, and the whole text of its file."""

    room: str
    file: str
    line: int
    was: str
    is_now: str
    text: str

    @property
    def name(self) -> str:
        """Name in ``mutation.toml``: lines move, so their numbers are not in it."""
        return f"{self.file} `{self.was}` → `{self.is_now}`"


def operators() -> dict[str, Any]:
    """Return instances of `OPERATORS`, and one that removes a statement's work."""
    from cosmic_ray.operators.operator import Operator
    from cosmic_ray.plugins import get_operator
    from parso.python.tree import Keyword

    class RemoveStatement(Operator):
        """``return x`` becomes ``return None``; a raise, call or write into something, ``pass``.

        The first assignment to a plain name stays: without it any test ends in a NameError.
        """

        def mutation_positions(self, node: Any) -> Iterator[Any]:
            kind, parts = node.type, list(getattr(node, "children", ()))
            called = kind in ("atom_expr", "power") and node.parent.type == "simple_stmt"
            plain = kind == "expr_stmt" and parts[0].type == "name"
            plain = plain and not (parts[1].type == "operator" and parts[1].value not in "=:")
            if (
                called
                or kind in ("raise_stmt", "return_stmt")
                or (kind == "expr_stmt" and not plain)
            ):
                yield node.start_pos, node.end_pos

        def mutate(self, node: Any, index: int) -> Any:
            new = "return None" if node.type == "return_stmt" else "pass"
            return Keyword(new, node.start_pos, node.get_first_leaf().prefix)

        @classmethod
        def examples(cls) -> tuple[()]:
            return ()

    made = {name: get_operator(f"core/{name}")() for name in OPERATORS}
    return {**made, "RemoveStatement": RemoveStatement()}


def without_annotations(code: str) -> str:
    """Return a module's syntax tree as text, without what only a type checker reads."""
    tree = ast.parse(code)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            node.returns = None
        elif isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(None)
    return ast.dump(tree)


def sources(room: str) -> dict[Path, str]:
    """Return the texts of the files that a room's faults are put into."""
    return {p: p.read_text("utf-8") for x in ROOMS[room][1] for p in sorted(ROOT.glob(x))}


def drawn(room: str) -> list[Fault]:
    """Return some of a room's faults, drawn from all of them; what changes nothing is no fault.

    They are in the order they were drawn in, so that the first of them are a sample too.
    """
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code

    texts = sources(room)
    places = [
        (path, operator, occurrence, start[0])
        for path in sorted(texts)
        for operator in operators().values()
        for occurrence, (start, _) in enumerate(
            x for n in ast_nodes(get_ast(texts[path])) for x in operator.mutation_positions(n)
        )
    ]
    random.Random(SEED).shuffle(places)
    out: dict[str, Fault] = {}
    for path, operator, occurrence, line in places:
        text = mutate_code(texts[path], operator, occurrence)
        try:
            if without_annotations(text) == without_annotations(texts[path]):
                continue
        except SyntaxError:
            continue
        was, now = (t.splitlines()[line - 1].strip() for t in (texts[path], text))
        fault = Fault(room, path.relative_to(ROOT).as_posix(), line, was, now, text)
        out.setdefault(fault.name, fault)
        if len(out) == ROOMS[room][0]:
            break
    return list(out.values())


# ---- tests ---------------------------------------------------------------------------------------


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    """Return a folder that is removed when this process ends, with a copy of the project."""
    out = tempfile.TemporaryDirectory(prefix="mutation-")
    shutil.copytree(ROOT, Path(out.name) / "project", ignore=COPIED)
    return out


def copy() -> Path:
    """Return this process's copy of the project."""
    return Path(_folder().name) / "project"


def pytest(tests: list[str], cpu_s: float, cached: bool) -> tuple[int, float]:
    """Run quick tests in the copy; return exit status and processor time [s].

    Args:
        tests: files and folders.
        cpu_s: processor time after which they are stopped [s]: a busy machine fails none.
        cached: whether compiled functions may be those of the sound code.
    """
    kept = copy().with_name("numba")
    if not cached:
        kept = Path(tempfile.mkdtemp(dir=copy().parent))
    environment = {
        **os.environ,
        **{f"{x}_NUM_THREADS": "1" for x in ("OMP", "OPENBLAS", "NUMBA")},
        "PYTHONPATH": str(copy()),
        "NUMBA_CACHE_DIR": str(kept),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    words = ["-m", "pytest", "-q", "-x", "-n0", "-p", "no:cacheprovider", "-m", "not slow", *tests]
    started = subprocess.Popen(
        [sys.executable, *words],
        cwd=copy(),
        env=environment,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (int(cpu_s), int(cpu_s) + 5)),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(started.pid, 0)
    if not cached:
        shutil.rmtree(kept)
    return os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime


@cache
def normal_s(tests: tuple[str, ...]) -> float:
    """Return the processor time of tests on the sound code [s]; fills the numba cache too."""
    status, seconds = pytest(list(tests), 3600.0, cached=True)
    assert status in (0, 5), f"{' '.join(tests)} fail without any fault"  # 5: nothing collected
    return seconds


def meet(fault: Fault) -> Row:
    """Return whether the tests notice a fault: those of its module first, then its room's."""
    own = sorted(copy().joinpath("tests").rglob(f"test_{Path(fault.file).stem}.py"))
    stages = [tuple(map(str, own)), ROOMS[fault.room][2]]
    limits = [START_S + TIMES_NORMAL * normal_s(tests) if tests else 0.0 for tests in stages]
    path = copy() / fault.file
    sound = path.read_text("utf-8")
    path.write_text(fault.text, "utf-8")
    try:
        noticed = any(
            pytest(list(tests), limit, cached="@compiled" not in sound)[0] not in (0, 5)
            for tests, limit in zip(stages, limits, strict=True)
            if tests
        )
    finally:
        path.write_text(sound, "utf-8")
    return {"noticed": noticed}


# ---- page ----------------------------------------------------------------------------------------


def page(found: dict[str, list[tuple[Fault, Row]]]) -> dict[str, Any]:
    """Return what the page's template asks for: scores by room, and every fault that lived."""
    said = tomllib.loads((STUDY.folder / "mutation.toml").read_text("utf-8"))
    scores, lived, total = [], [], Counter[str]()

    def score(name: str, n: Counter[str]) -> list[str]:
        rest = n["run"] - n["equivalent"]
        share = f"{n['noticed']} of {rest} ({100 * n['noticed'] / max(rest, 1):.0f} %)"
        return [name, str(n["run"]), str(n["noticed"]), str(n["equivalent"]), share]

    for room, faults in found.items():
        count = Counter[str](run=len(faults), noticed=sum(row["noticed"] for _, row in faults))
        for fault, row in sorted(faults, key=lambda x: (x[0].file, x[0].line, x[0].is_now)):
            if not row["noticed"]:
                verdict = said.get(fault.name, "")
                count["equivalent"] += verdict.startswith("equivalent")
                where = f"`{fault.file.removeprefix('stiction_envs/')}:{fault.line}`"
                lived.append([where, f"`{fault.was}`", f"`{fault.is_now}`", verdict])
        scores.append(score(f"`{room}`", count))
        total += count
    head = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(head, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return {
        "noticed": total["noticed"],
        "rest": total["run"] - total["equivalent"],
        "run": total["run"],
        "scores": table_text(
            ["room", "run", "noticed", "equivalent", "of the rest"],
            [*scores, score("all", total)],
        ),
        "lived": table_text(["where", "was", "became", "verdict"], lived),
        "seed": SEED,
        "commit": commit.strip(),
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=list(ROOMS))
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    found = {}
    for room in options.rooms:
        code = hashlib.sha256("".join(sources(room).values()).encode()).hexdigest()
        faults = {fault.name: fault for fault in drawn(room)}
        rows = Rows(options.work / f"{room}.jsonl", code).fill(
            faults, meet, processes=options.workers, minutes=options.minutes
        )
        found[room] = [(faults[name], row) for name, row in rows.items()]
    STUDY.write_page(options, **page(found))


if __name__ == "__main__":
    main()
