"""What each setting of `diagnose` is worth: blind cases, diagnosed with it halved and doubled.

    python -m benchmarks.accuracy.sensitivity --rounds 2 [--settings selection noise.seen]

Cases are those of `blind_logs`, round after round; one whose effect is not visible is left out,
since it is not counted there either.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import partial
from typing import Any

from benchmarks.accuracy.blind_logs import MADE_BY, Job, judge, plan, row_of
from benchmarks.accuracy.blind_logs_page import visible
from benchmarks.harness import Benchmark, Row
from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.gap.settings import gap_settings
from stiction_envs.method_settings import override
from stiction_envs.reporting.markdown import table_text

STUDY = Benchmark(__file__, __doc__, made_by=(*MADE_BY, "benchmarks/accuracy/sensitivity.py"))
DEFAULT = ""
"""Name of the run in which nothing is changed."""


def numbers(settings: Any, prefix: str = "") -> Iterator[tuple[str, int | float]]:
    """Yield name and value of every number in settings."""
    for field in fields(settings):
        value, name = getattr(settings, field.name), f"{prefix}{field.name}"
        if is_dataclass(value):
            yield from numbers(value, f"{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield name, value


def variants(wanted: tuple[str, ...] = ()) -> dict[str, dict[str, float]]:
    """Return changes by name: every setting halved and doubled, after the defaults."""
    out: dict[str, dict[str, float]] = {DEFAULT: {}}
    for name, value in numbers(gap_settings()):
        if not wanted or name.startswith(wanted):
            for factor in (0.5, 2.0):
                new = factor * value
                if isinstance(value, int):
                    new = max(1, round(new))
                out[f"{name} = {new:g}"] = {name: new}
    return {name: change for name, change in out.items() if allowed(change)}


def allowed(change: dict[str, float]) -> bool:
    """Return whether changed settings are in their ranges."""
    try:
        override(gap_settings(), change)
    except StictionError:
        return False
    return True


def run(job: Job, changes: dict[str, dict[str, float]]) -> Row:
    """Diagnose a case with every change, if everything that is hidden is visible."""
    with_defaults = row_of(job)
    if "broken" in with_defaults or not visible(with_defaults):
        return {"rows": {}}
    case, rows = job.case(), {DEFAULT: with_defaults}
    for name, change in changes.items():
        if change:
            found = diagnose_logs(case.logs, case.robot, nominal=case.nominal, settings=change)
            rows[name] = judge(case, found, job.causes)
    return {"rows": rows}


def counted(rows: list[Row]) -> list[str]:
    """Return cells of the table: what is right of some cases."""
    single, none, pairs = ([r for r in rows if len(r["hidden"]) == k] for k in (1, 0, 2))
    first = [r["named"][:1] == r["expected"] for r in single]
    both = [set(r["expected"]) <= set(r["named"]) for r in pairs]
    inside = [ok for r in single for ok in r["inside"].values()]
    parts = (first, [bool(r["named"]) for r in none], both, inside)
    return [f"{sum(part)}/{len(part)}" for part in parts]


def page(cases: list[dict[str, Row]], names: list[str]) -> dict[str, Any]:
    """Return what the page's template asks for, of cases by the names of changes."""
    values, lines, changing = dict(numbers(gap_settings())), [], dict[str, None]()
    for name in names:
        mine = [case[name] for case in cases]
        setting, _, new = name.partition(" = ")
        if name == DEFAULT:
            lines.append(["defaults", "", "", *counted(mine), ""])
            continue
        other = sum(set(case[name]["named"]) != set(case[DEFAULT]["named"]) for case in cases)
        changing |= {f"`{setting}`": None} if other else {}
        lines.append([setting, f"{values[setting]:g}", new, *counted(mine), str(other or "")])
    header = ["setting", "default", "changed to", "strongest is the hidden one"]
    header += ["nothing hidden, yet a cause named", "two hidden, both named"]
    header += ["true value in interval", "other causes than with the defaults"]
    return {
        "settings": len({name.partition(" = ")[0] for name in names} - {DEFAULT}),
        "variants": len(names),
        "changing": list(changing),
        "cases": len(cases),
        "table": table_text(header, lines),
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--rounds", type=int, default=2, help="of the blind study's plan")
    parser.add_argument("--settings", nargs="+", default=(), help="beginnings of their names")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    options = parser.parse_args()
    changes = variants(tuple(options.settings))
    jobs = [job for job in plan(options.rounds) if job.unclear < 0 and len(job.causes) < 3]
    # what is rare first, so that a study that is stopped says something of it too
    jobs.sort(key=lambda job: len(job.causes) == 1)
    found = STUDY.rows(options).fill(
        {f"{job.key} {' '.join(options.settings)}": job for job in jobs},
        partial(run, changes=changes),
        processes=options.processes,
        minutes=options.minutes,
    )
    cases = [row["rows"] for row in found.values() if row["rows"]]
    STUDY.write_page(
        options,
        rounds=options.rounds,
        planned=len(jobs),
        missing=len(jobs) - len(found),
        unseen=len(found) - len(cases),
        **page(cases, list(changes)),
    )


if __name__ == "__main__":
    main()
