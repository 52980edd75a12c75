"""What the tests notice: small faults in the code, one at a time, each met by its room's tests.

    python -m benchmarks.mutation --work DIR                # goes on where it was stopped
    python -m benchmarks.mutation --work DIR --suite slow   # what the quick tests let live
    python -m benchmarks.mutation --work DIR --suite again  # what lives, with the tests as they are
    python -m benchmarks.mutation --work DIR --report       # benchmarks/mutation.md

Needs the extra ``mutation`` (cosmic-ray, whose operators make the mutants). A fixed random sample
of each room's mutants is drawn once and kept in DIR, with copies of the tree to run in; each result
is a line of ``results.jsonl``. Tests that are likely to fail come first (`meet`); a
mutant that takes four times the processor time of its tests counts as killed.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from benchmarks.mutation_sample import ROOMS, ROOT, SEED, Mutant, digest, drawn
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.templates import render

TIMES_NORMAL = 4
START_S = 30.0
"""Processor time to import and compile everything [s]."""
VERDICTS = Path(__file__).with_suffix(".toml")
"""What we think of each mutant that lived, by its name."""
TEMPLATE = Path(__file__).parent / "mutation.md.j2"


def sample(room: str, work: Path) -> list[Mutant]:
    """Return a room's mutants as they were drawn, or draw them."""
    kept = work / f"sample-{room}.json"
    if not kept.exists():
        head = ["git", "rev-parse", "--short", "HEAD"]
        commit = subprocess.run(head, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        mutants = [vars(m) for m in drawn(room)]
        made = {"commit": commit.strip(), "sources": digest(room), "mutants": mutants}
        kept.write_text(json.dumps(made, indent=1), "utf-8")
    return [Mutant(**row) for row in json.loads(kept.read_text("utf-8"))["mutants"]]


def kept_of(room: str, work: Path, what: str) -> str:
    """Return the commit of a drawn sample, or the digest of its sources."""
    return str(json.loads((work / f"sample-{room}.json").read_text("utf-8"))[what])


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
        self.cache.mkdir(parents=True, exist_ok=True)
        listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for name in names.splitlines():
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name)

    def pytest(self, *arguments: str, cpu_s: float = 3600.0, cache: Path | None = None) -> Run:
        """Run tests, stopped past ``cpu_s`` of processor time: a busy machine fails none.

        With a ``cache`` of compiled functions that is not the tree's, no byte code is kept either.
        """
        environment = {
            **os.environ,
            **{f"{x}_NUM_THREADS": "1" for x in ("OMP", "OPENBLAS", "NUMBA")},
            "PYTHONPATH": str(self.folder),
            "NUMBA_CACHE_DIR": str(cache or self.cache),
            "PYTHONDONTWRITEBYTECODE": "1" if cache else "",
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

    def mutate(self, mutant: Mutant, stages: list[tuple[list[str], float]]) -> Run:
        """Run lists of tests, each in its processor time, with one fault, until one fails.

        Afterwards the tree is as before, to the time stamp. Where functions are compiled, the
        folder's are compiled anew, since numba does not see that what they call has changed.
        """
        path = self.folder / mutant.file
        listed = self.folder.with_suffix(".tests")
        shutil.rmtree(self.fresh, ignore_errors=True)
        compiled = f"{path.parent.name}_*" if "@compiled" in mutant.text else ""
        shutil.copytree(self.cache, self.fresh, ignore=shutil.ignore_patterns(compiled))
        stamp = path.stat()
        sound = path.read_bytes()
        path.write_text(mutant.text, "utf-8")
        try:
            for asked, cpu_s in stages:
                listed.write_text("\n".join(asked), "utf-8")
                run = self.pytest("-x", f"@{listed}", cpu_s=cpu_s, cache=self.fresh)
                if run.status:
                    break
            return run
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


def verdicts() -> dict[str, str]:
    """Return what was written of mutants, by their names."""
    return tomllib.loads(VERDICTS.read_text("utf-8")) if VERDICTS.exists() else {}


def equivalent(mutant: Mutant) -> bool:
    """Whether a mutant was judged to change no result."""
    return verdicts().get(mutant.name, "").startswith("equivalent")


def meet(
    mutant: Mutant, tests: dict[str, float], cpu_s: float, tree: Tree, killers: list[str]
) -> dict[str, Any]:
    """Return what became of a mutant.

    Asked first: ``killers``, which found faults of its file, and its module's tests or, without
    any, its folder's. Those may take less time before they count as endless. A mutant that was
    judged to be equivalent meets no others.
    """
    own = [name for name in tests if f"/test_{Path(mutant.file).stem}.py::" in name]
    room = [name for name in tests if name.startswith(f"tests/{Path(mutant.file).parent.name}/")]
    first = list(dict.fromkeys(n for n in (*killers, *(own or room)) if n in tests))
    rest = sorted((n for n in tests if n not in set(first)), key=lambda n: n not in room)
    short = sum(tests[n] for n in first) + START_S
    stages = [(first, short), (rest, 0.0 if equivalent(mutant) else cpu_s)]
    began = time.monotonic()
    run = tree.mutate(mutant, [(asked, TIMES_NORMAL * s) for asked, s in stages if asked and s])
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


def killed(known: dict[tuple[str, str], dict[str, Any]], mutant: Mutant) -> bool:
    """Whether quick tests kill a mutant, those of before or those of now."""
    return any(lives(known, mutant, suite) is False for suite in ("quick", "again"))


def due(room: str, suite: str, work: Path) -> list[Mutant]:
    """Return the mutants that a suite has yet to meet; for ``again``, all not known as killed."""
    known = results(work)
    out = sample(room, work)
    if suite == "again":
        return [m for m in out if not killed(known, m)]
    if suite == "slow":
        out = [m for m in out if lives(known, m, "quick")]
    return [m for m in out if lives(known, m, suite) is None]


def run(room: str, suite: str, work: Path, trees: list[Tree]) -> None:
    """Let a room's mutants meet a suite: ``quick``, ``slow``, or ``again``, the quick one now."""
    todo = due(room, suite, work)
    if not todo:
        return
    same = kept_of(room, work, "sources") == digest(room)
    assert same, f"{room}: sources have changed since the sample was drawn"
    tests, cpu_s = tests_of(room, suite, trees[0])
    free: SimpleQueue[Tree] = SimpleQueue()
    for tree in trees:
        free.put(tree)
    for tree in trees[1:]:  # unbroken, they pass in this order too; fills the tree's cache
        (listed := tree.folder.with_suffix(".tests")).write_text("\n".join(tests), "utf-8")
        sound = tree.pytest("-x", f"@{listed}")
        assert sound.status == 0, sound.log[-3000:]

    found: dict[str, Counter[str]] = {m.file: Counter() for m in todo}
    for known in results(work).values():
        found.get(known["mutant"].split(":")[0], Counter()).update([known["by"]])

    def one(mutant: Mutant) -> None:
        tree = free.get()
        killers = [name for name, _ in found[mutant.file].most_common()]
        row = {"suite": suite, **meet(mutant, tests, cpu_s, tree, killers)}
        found[mutant.file].update([row["by"]])
        free.put(tree)
        with (work / "results.jsonl").open("a", encoding="utf-8") as out:
            out.write(json.dumps(row, ensure_ascii=False) + "\n")
        print(f"{room} {row['seconds']:6.1f} s {row['outcome']:8} {mutant.name}", flush=True)

    with ThreadPoolExecutor(len(trees)) as pool:
        list(pool.map(one, todo))


def report(rooms: list[str], work: Path) -> str:
    """Return the page: scores by room, and every mutant that some quick suite let live."""
    known, said = results(work), verdicts()
    scores, listed, total = [], [], Counter[str]()
    for room in rooms:
        counts, mutants = Counter[str](), sample(room, work)
        for m in mutants:
            before, now = lives(known, m, "quick"), lives(known, m, "again")
            ran, ended = before is not None or now is not None, killed(known, m)
            counts += Counter(
                run=ran,
                before=before is not None,
                killed_before=before is False,
                killed=ended,
                equivalent=ran and not ended and equivalent(m),
            )
            if before or now:
                slow = lives(known, m, "slow") is False
                fate = "killed now" if ended else "killed by slow tests" if slow else "lives"
                where = f"`{m.file.removeprefix('stiction_envs/')}:{m.line}`"
                was, is_now = (f"`{text}`" for text in (m.was, m.is_now))
                listed.append([where, was, is_now, fate, said.get(m.name, "")])
        scores.append(score(f"`{room}`", counts))
        total += counts
    scores.append(score("all", total))
    return render(
        TEMPLATE,
        seed=SEED,
        commits=" and ".join(sorted({kept_of(room, work, "commit") for room in rooms})),
        run=total["run"],
        before=total["before"],
        drawn=sum(len(sample(room, work)) for room in rooms),
        scores=table_text(COLUMNS, scores),
        noticed=(total["killed"], total["run"] - total["equivalent"]),
        survivors=table_text(["where", "was", "became", "and now", "verdict"], listed),
    )


COLUMNS = ["room", "run", "killed by the earlier tests", "killed now", "equivalent", "of the rest"]


def score(name: str, n: Counter[str]) -> list[str]:
    """Return a row of the page: mutants, those killed before and now, those that are none."""

    def share(part: int, whole: int) -> str:
        return f"{part} of {whole} ({100 * part / whole:.0f} %)" if whole else "not run"

    return [
        name,
        str(n["run"]),
        share(n["killed_before"], n["before"]),
        share(n["killed"], n["run"]),
        str(n["equivalent"]),
        share(n["killed"], n["run"] - n["equivalent"]),
    ]


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
