"""What the tests notice: small faults in the code, one at a time, each met by its room's tests.

    python -m benchmarks.mutation --work DIR                # goes on where it was stopped
    python -m benchmarks.mutation --work DIR --suite slow   # what the quick tests let live
    python -m benchmarks.mutation --work DIR --suite again  # what lives, with the tests as they are
    python -m benchmarks.mutation --work DIR --report       # benchmarks/mutation.md

Needs the extra ``mutation`` (cosmic-ray, whose operators make the mutants). A fixed random sample
of each room's mutants is drawn once and kept in DIR, with copies of the tree to run in; each result
is a line of ``results.jsonl``. Tests run in the order of `tests_of`, so that the first failure
comes soon; a mutant that takes four times the processor time of its tests counts as killed.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
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
TIMES_NORMAL = 4
VERDICTS = Path(__file__).with_suffix(".toml")
"""What we think of each mutant that lived, by its name."""
PAGE = """\
# What the tests notice

Small faults were put into the code one at a time, at random (seed 12), and each met the tests of
its room: `python -m benchmarks.mutation --work DIR`. *Before*: the tests as they were, the quick
ones alone or the slow ones too; *after*: the quick ones (`make test`) with those written for what
had lived.

| room | mutants | quick, before | quick and slow, before | quick, after |
|---|---|---|---|---|
{scores}

## What the quick tests first let live

| where | was | became | and then | verdict |
|---|---|---|---|---|
{survivors}
"""


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


def sample(room: str) -> list[Mutant]:
    """Return a room's mutants, drawn from all of them; what is none is passed over."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code

    size, patterns, _ = ROOMS[room]
    sources = {p: p.read_text("utf-8") for pattern in patterns for p in ROOT.glob(pattern)}
    places = [
        (path, name, operator, occurrence, start[0])
        for path in sorted(sources)
        for name, operator in operators().items()
        for occurrence, (start, _) in enumerate(
            x for n in ast_nodes(get_ast(sources[path])) for x in operator.mutation_positions(n)
        )
    ]
    random.Random(SEED).shuffle(places)
    out: list[Mutant] = []
    for path, name, operator, occurrence, line in places:
        text = mutate_code(sources[path], operator, occurrence)
        try:
            if without_annotations(text) == without_annotations(sources[path]):
                continue
        except SyntaxError:
            continue
        was, now = (t.splitlines()[line - 1].strip() for t in (sources[path], text))
        out.append(Mutant(room, str(path.relative_to(ROOT)), line, name, was, now, text))
        if len(out) == size:
            break
    return sorted(out, key=lambda m: (m.file, m.line, m.operator, m.is_now))


@dataclass(frozen=True)
class Run:
    """How a run of pytest ended."""

    status: int
    cpu_s: float
    log: str


class Tree:
    """A copy of the project to break, with byte code and numba's cache of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.cache = folder.with_name(f"{folder.name}-numba")
        self.fresh = folder.with_name(f"{folder.name}-numba-fresh")
        shutil.rmtree(folder, ignore_errors=True)
        listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for name in names.splitlines():
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)

    def pytest(self, *arguments: str, cpu_s: float = 3600.0, mutated: str = "") -> Run:
        """Run tests, stopped past ``cpu_s`` of processor time: a busy machine fails none.

        Byte code of a ``mutated`` file is not kept. Where functions are compiled, its folder's are
        compiled anew, since numba does not see that what they call has changed.
        """
        cache = self.cache
        if mutated and "@compiled" in (self.folder / mutated).read_text("utf-8"):
            shutil.rmtree(self.fresh, ignore_errors=True)
            room = shutil.ignore_patterns(f"{Path(mutated).parent.name}_*")
            shutil.copytree(self.cache, self.fresh, ignore=room)
            cache = self.fresh
        environment = {
            **os.environ,
            **{f"{x}_NUM_THREADS": "1" for x in ("OMP", "OPENBLAS", "NUMBA")},
            "PYTHONPATH": str(self.folder),
            "NUMBA_CACHE_DIR": str(cache),
            "PYTHONDONTWRITEBYTECODE": "1" if mutated else "",
        }
        limit = (int(cpu_s), int(cpu_s) + 5)
        with tempfile.TemporaryFile("w+") as log:
            started = subprocess.Popen(
                [sys.executable, "-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider", *arguments],
                cwd=self.folder,
                env=environment,
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, limit),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
            _, status, used = os.wait4(started.pid, 0)
            log.seek(0)
            return Run(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, log.read())

    def mutate(self, mutant: Mutant, arguments: list[str], cpu_s: float) -> Run:
        """Run tests with one fault in the tree; afterwards it is as before, to the time stamp."""
        path = self.folder / mutant.file
        stamp = path.stat()
        sound = path.read_bytes()
        path.write_text(mutant.text, "utf-8")
        try:
            return self.pytest("-x", *arguments, cpu_s=cpu_s, mutated=mutant.file)
        finally:
            path.write_bytes(sound)
            os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))


def seconds_of_tests(log: str) -> dict[str, float]:
    """Return the seconds of each test with its fixtures, from ``--durations=0 -vv``."""
    out: dict[str, float] = {}
    for line in log.splitlines():
        found = re.match(r"\s*([\d.]+)s (?:call|setup|teardown)\s+(tests/\S.*)$", line)
        if found:
            out[found[2]] = out.get(found[2], 0.0) + float(found[1])
    return out


def tests_of(room: str, which: str, tree: Tree) -> tuple[dict[str, float], float]:
    """Return a room's tests, short ones first, and the processor time that they take in all.

    A file stays together for its fixtures: files in the order of their time, tests within a file.
    """
    kept = tree.folder.parent / f"tests-{room}-{which}.json"
    if kept.exists():
        return tuple(json.loads(kept.read_text("utf-8")))
    marked = ["-m", "slow" if which == "slow" else "not slow", *ROOMS[room][2]]
    run = tree.pytest("--durations=0", "-vvv", *marked)
    assert run.status == 0, run.log[-3000:]
    seconds = seconds_of_tests(run.log)
    files: dict[str, float] = {}
    for name, s in seconds.items():
        files[name.split("::")[0]] = files.get(name.split("::")[0], 0.0) + s
    ordered = sorted(seconds, key=lambda n: (files[n.split("::")[0]], n.split("::")[0], seconds[n]))
    out = {n: seconds[n] for n in ordered}, run.cpu_s
    kept.write_text(json.dumps(out, indent=1), "utf-8")
    return out


def meet(mutant: Mutant, tests: dict[str, float], cpu_s: float, tree: Tree) -> dict[str, Any]:
    """Return what became of a mutant: its own module's tests are asked first, then all."""
    own = [name for name in tests if f"/test_{Path(mutant.file).stem}.py::" in name]
    listed = tree.folder.with_suffix(".tests")
    began = time.monotonic()
    for asked in filter(None, (own, list(tests))):
        listed.write_text("\n".join(asked), "utf-8")
        run = tree.mutate(mutant, [f"@{listed}"], TIMES_NORMAL * cpu_s)
        if run.status:
            break
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", run.log, re.M)
    outcome = {0: "survived", -signal.SIGXCPU: "timeout", -signal.SIGKILL: "timeout"}
    return {
        "room": mutant.room,
        "mutant": mutant.name,
        "operator": mutant.operator,
        "outcome": outcome.get(run.status, "killed"),
        "status": run.status,
        "by": failed[1] if failed else "",
        "seconds": round(time.monotonic() - began, 1),
    }


def results(work: Path) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the last result of each mutant (its name and operator) and suite."""
    path = work / "results.jsonl"
    rows = map(json.loads, path.read_text("utf-8").splitlines()) if path.exists() else ()
    return {(row["mutant"] + row["operator"], row["suite"]): row for row in rows}


def lives(known: dict[tuple[str, str], dict[str, Any]], mutant: Mutant, suite: str) -> bool | None:
    """Whether a mutant lived through a suite; None if it has not met it."""
    row = known.get((mutant.name + mutant.operator, suite))
    return None if row is None else row["outcome"] == "survived"


def due(room: str, suite: str, work: Path) -> list[Mutant]:
    """Return the mutants that a suite has yet to meet; for ``again``, all that are alive."""
    known = results(work)
    out = sample(room)
    if suite == "quick":
        return [m for m in out if lives(known, m, "quick") is None]
    alive = [m for m in out if lives(known, m, "quick")]
    if suite == "slow":
        return [m for m in alive if lives(known, m, "slow") is None]
    return [m for m in alive if lives(known, m, "again") is not False]


def run(room: str, suite: str, work: Path, trees: list[Tree]) -> None:
    """Let a room's mutants meet a suite: ``quick``, ``slow``, or ``again``, the quick one now."""
    todo = due(room, suite, work)
    if not todo:
        return
    tests, cpu_s = tests_of(room, suite, trees[0])
    free: SimpleQueue[Tree] = SimpleQueue()
    for tree in trees:
        free.put(tree)
    (listed := trees[-1].folder.with_suffix(".tests")).write_text("\n".join(tests), "utf-8")
    sound = trees[-1].pytest("-x", f"@{listed}")  # unbroken, they pass in this order too
    assert sound.status == 0, sound.log[-3000:]

    def one(mutant: Mutant) -> None:
        tree = free.get()
        row = {"suite": suite, **meet(mutant, tests, cpu_s, tree)}
        free.put(tree)
        with (work / "results.jsonl").open("a", encoding="utf-8") as out:
            out.write(json.dumps(row, ensure_ascii=False) + "\n")
        print(f"{room} {row['seconds']:6.1f} s {row['outcome']:8} {mutant.name}", flush=True)

    with ThreadPoolExecutor(len(trees)) as pool:
        list(pool.map(one, todo))


def report(rooms: list[str], work: Path) -> str:
    """Return the page: scores by room, and every mutant that the quick tests first let live."""
    known = results(work)
    verdicts = tomllib.loads(VERDICTS.read_text("utf-8")) if VERDICTS.exists() else {}
    lines, listed = [], []
    for room in rooms:
        met = [m for m in sample(room) if lives(known, m, "quick") is not None]
        alive = [m for m in met if lives(known, m, "quick")]
        slow = [m for m in alive if lives(known, m, "slow") is False]
        again = [m for m in alive if lives(known, m, "again") is False]
        n = len(met)
        counts = (n - len(alive), n - len(alive) + len(slow), n - len(alive) + len(again))
        shares = " | ".join(f"{k} ({100 * k / max(n, 1):.0f} %)" for k in counts)
        lines.append(f"| `{room}` | {n} | {shares} |")
        for m in alive:
            now = "killed now" if m in again else "killed by slow tests" if m in slow else "lives"
            why = verdicts.get(m.name, "")
            was, is_now = (text.replace("|", "\\|") for text in (m.was, m.is_now))
            listed.append(f"| `{m.file}:{m.line}` | `{was}` | `{is_now}` | {now} | {why} |")
    return PAGE.format(scores="\n".join(lines), survivors="\n".join(listed))


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, required=True, help="copies of the tree, and results")
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=list(ROOMS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--suite", choices=("quick", "slow", "again"), default="quick")
    parser.add_argument("--report", action="store_true")
    asked = parser.parse_args(argv)
    if asked.report:
        VERDICTS.with_suffix(".md").write_text(report(asked.rooms, asked.work), "utf-8")
        return
    work = asked.work.resolve()
    work.mkdir(parents=True, exist_ok=True)
    trees = [Tree(work / f"tree-{k}") for k in range(asked.workers)]
    for room in asked.rooms:
        run(room, asked.suite, work, trees)


if __name__ == "__main__":
    main()
