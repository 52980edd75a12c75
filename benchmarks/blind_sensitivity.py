"""What each threshold is worth: cases of the blind study, diagnosed with it halved and doubled.

    python -m benchmarks.blind_sensitivity --rounds 2 --out benchmarks

Cases are those of `benchmarks.blind_logs`, round after round; an effect that nobody can see is left
out, since it is not counted there either. Every diagnosis is a line of
``blind_sensitivity.jsonl`` in ``--work``; a study that was stopped goes on where it stopped. Writes
the last section of ``blind_logs.md``, from its mark on.
"""

from __future__ import annotations

import argparse
import copy
import dataclasses
import json
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from hashlib import blake2b
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from tqdm import tqdm

from benchmarks._blind_logs_page import SENSITIVITY, Row, visible
from benchmarks.blind_logs import NOTHING, PAIRS, Job, judge, plan
from stiction_envs.errors import StictionError
from stiction_envs.gap.causes import Cause, TorqueShift, registered
from stiction_envs.gap.diagnosis import diagnose
from stiction_envs.gap.settings import SelectionSettings, gap_settings
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.testing.hidden_effects import EFFECTS

THRESHOLDS = (
    *(f"selection.{f.name}" for f in dataclasses.fields(SelectionSettings)),
    "candidates.huber",
    "noise.seen",
    "estimates.interval",
)
DEFAULT = ""
"""Name of the run in which nothing is changed."""
Key = tuple[int, tuple[str, ...], str]
"""Seed, what was hidden, and what was changed."""


def value_of(name: str) -> float:
    """Return the default of a setting."""
    value: Any = gap_settings()
    for part in name.split("."):
        value = getattr(value, part)
    return value  # type: ignore[no-any-return]


def variants() -> dict[str, dict[str, float]]:
    """Return changes by name: every threshold halved and doubled, after the defaults."""
    out: dict[str, dict[str, float]] = {DEFAULT: {}}
    for name in THRESHOLDS:
        value = value_of(name)
        for factor in (0.5, 2.0):
            whole = isinstance(value, int)
            new = max(1, round(factor * value)) if whole else factor * value
            out[f"{name} = {new:g}"] = {name: new}
    return out


def sharing_columns() -> list[Cause]:
    """Return the causes, each of which works out its columns once for all diagnoses of a case.

    None of `THRESHOLDS` is in them. What they depend on besides the log is the nominal torque and
    dry friction, which a payload or a delay that was found changes.
    """
    known: dict[tuple[Any, ...], Any] = {}
    states: WeakKeyDictionary[Data, bytes] = WeakKeyDictionary()

    def state(data: Data) -> bytes:
        if data not in states:
            model, distance = data.model, data.friction.presliding_distance
            parts = [
                x for x in (model.whole, model.rigid, model.carried, distance) if x is not None
            ]
            states[data] = blake2b(b"".join(x.tobytes() for x in parts)).digest()
        return states[data]

    def once(cause: Cause, method: str) -> Callable[..., Any]:
        work = getattr(cause, method)

        def known_or_new(data: Data, joint: int, *rest: Any) -> Any:
            shape = rest if method != "shapes" else ()
            key = (cause.name, method, state(data), joint, shape)
            if key not in known:
                known[key] = work(data, joint, *rest)
            return known[key]

        return known_or_new

    out = []
    for cause in registered():
        mine = cause
        if not isinstance(cause, TorqueShift):  # which makes others of its kind
            mine = copy.copy(cause)
            for method in ("columns", "spread", "shapes"):
                setattr(mine, method, once(cause, method))
        out.append(mine)
    return out


def counts(row: Row) -> bool:
    """Whether a case is one of those that the study counts: everything hidden can be seen."""
    if "broken" in row:
        return False
    return visible(row)


def run(job: Job, todo: list[str]) -> list[Row]:
    """Diagnose a case with some of the variants."""
    same = {"seed": job.seed, "hidden": list(job.causes)}
    try:
        case = job.case()
    except StictionError as error:
        return [same | {"changed": DEFAULT, "broken": str(error)}]
    rows: list[Row] = []
    causes = sharing_columns()
    for name in todo:
        start = time.perf_counter()
        found = diagnose(
            case.logs, case.robot, nominal=case.nominal, causes=causes, settings=variants()[name]
        )
        row = judge(case, found, job.causes) | {
            "changed": name,
            "seconds": time.perf_counter() - start,
        }
        rows.append(row)
        if not counts(row):
            break
    return rows


def study(rounds: int, work: Path, minutes: float, processes: int) -> list[Row]:
    """Run what is not yet on disk, for so many minutes at most; return the rows of these rounds."""
    path = work / "blind_sensitivity.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    rows: list[Row] = [json.loads(line) for line in lines if line.endswith("}")]
    have = {_key(r): r for r in rows}
    jobs = [job for job in plan(rounds) if job.unclear < 0 and len(job.causes) < 3]
    # what is rare first, so that a study that is stopped says something of it too
    jobs.sort(key=lambda job: len(job.causes) == 1)
    todo = []
    for job in jobs:
        first = have.get((job.seed, job.causes, DEFAULT))
        left = [x for x in variants() if (job.seed, job.causes, x) not in have]
        if left and (first is None or counts(first)):
            todo.append((job, left))
    end = time.monotonic() + 60 * minutes
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"))
    with path.open("a") as file, pool:
        some = zip(*todo, strict=True) if todo else ((), ())
        for new in tqdm(pool.map(run, *some), desc="sensitivity", total=len(todo)):
            file.writelines(json.dumps(row) + "\n" for row in new)
            file.flush()
            rows += new
            if time.monotonic() > end:
                pool.shutdown(cancel_futures=True)
                break
    wanted = {(job.seed, job.causes) for job in jobs}
    return [r for r in rows if _key(r)[:2] in wanted]


def _key(row: Row) -> Key:
    return row["seed"], tuple(row["hidden"]), row["changed"]


def section(rows: list[Row], rounds: int) -> str:
    """Return the section: of the cases that were diagnosed with every variant."""
    names = list(variants())
    by = {_key(r): r for r in rows if counts(r)}
    cases = [k[:2] for k in by if k[2] == DEFAULT]
    cases = [c for c in cases if all((*c, x) in by for x in names)]
    sets = {x: [by[*c, x] for c in cases] for x in names}
    jobs = [job for job in plan(rounds) if job.unclear < 0 and len(job.causes) < 3]
    unseen = sum(not counts(r) for r in rows if r["changed"] == DEFAULT)
    many = "round" if rounds == 1 else f"{rounds} rounds"
    lines = [
        SENSITIVITY,
        "## What each threshold is worth",
        "",
        f"Made by `python -m benchmarks.blind_sensitivity --rounds {rounds}`: the first {many} of "
        f"the study ({len(EFFECTS)} causes, {NOTHING} times nothing, {PAIRS} pairs in "
        f"each), seeds {_seeds(jobs)}. Of {len(jobs)} cases {unseen} hide what nobody can see, "
        f"{len(jobs) - unseen - len(cases)} were not run. The other {len(cases)} were diagnosed "
        f"{len(names)} times each: with the defaults, and with one setting of "
        "`gap/settings.toml` halved or doubled (whole numbers rounded). The last column counts the "
        "cases in which a cause is named that the defaults do not name, or the other way round. A "
        "setting that changes nothing here may still matter elsewhere: the cases are few.",
        "",
        "| setting | default | changed to | strongest is the hidden one "
        "| nothing hidden, yet a cause named | two hidden, both named | true value in interval "
        "| other causes than with the defaults |",
        "|---|---|---|---|---|---|---|---|",
        f"| defaults | | | {_table_cells(sets[DEFAULT])} | |",
    ]
    for name in names[1:]:
        setting, new = name.split(" = ")
        pairs = list(zip(sets[name], sets[DEFAULT], strict=True))
        other = sum(set(r["named"]) != set(was["named"]) for r, was in pairs)
        lines.append(
            f"| {setting} | {value_of(setting):g} | {new} | {_table_cells(sets[name])} "
            f"| {other or ''} |"
        )
    return "\n".join(lines) + "\n"


def _seeds(jobs: list[Job]) -> str:
    """Return the seeds of cases, runs of them as first and last."""
    seeds = sorted({job.seed for job in jobs})
    runs = [
        (s, next(x for x in range(s, s + len(seeds)) if x + 1 not in seeds))
        for s in seeds
        if s - 1 not in seeds
    ]
    return ", ".join(f"{a} to {b}" if b > a else str(a) for a, b in runs)


def _table_cells(rows: list[Row]) -> str:
    single = [r for r in rows if len(r["hidden"]) == 1]
    none = [r for r in rows if not r["hidden"]]
    pairs = [r for r in rows if len(r["hidden"]) == 2]
    first = sum(r["named"][:1] == r["expected"] for r in single)
    both = sum(set(r["expected"]) <= set(r["named"]) for r in pairs)
    inside = [ok for r in single for ok in r["inside"].values()]
    return (
        f"{first}/{len(single)} | {sum(bool(r['named']) for r in none)}/{len(none)} "
        f"| {both}/{len(pairs)} | {sum(inside)}/{len(inside)}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--rounds", type=int, default=2, help="of the study's plan")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    parser.add_argument(
        "--work", type=Path, default=Path(tempfile.gettempdir()) / "blind_logs", help="case lines"
    )
    parser.add_argument("--minutes", type=float, default=np.inf, help="stop after this long")
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    rows = study(args.rounds, args.work, args.minutes, args.processes)
    text = section(rows, args.rounds)
    page = args.out / "blind_logs.md"
    page.write_text(page.read_text("utf-8").partition(SENSITIVITY)[0].rstrip() + "\n\n" + text)
    print(text)


if __name__ == "__main__":
    main()
