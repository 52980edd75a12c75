"""Which numbers of the judge matter: each halved and doubled, on hidden causes and on real logs.

    python -m benchmarks.accuracy.constants

A case is a log of `blind_logs` whose links are 3 % off, or one of `every_log` that takes a few
seconds. A tuple of a module is halved and doubled as a whole.
"""

import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy import blind_logs, every_log
from benchmarks.harness import LOGS, MEASURED, Benchmark, Row
from stiction_envs.hidden.hidden_logs import HiddenLogs
from stiction_envs.reporting.markdown import table_text

STUDY = Benchmark(__file__, __doc__, made_by=(*LOGS, "benchmarks/accuracy/*.py"))
CONSTANTS = {
    "nats that a name needs": "gap.judge.search:NAMED",
    "size of every linear cause's prior": "gap.predictors.torque:PARTS",
    "time between observations": "gap.predictors.torque:APART",
    "variance of rows at rest": "gap.predictors.torque:RESTING",
    "angle of the same place": "gap.predictors.torque:CELL",
    "shares δ of the torque that no model has": "gap.predictors.torque:SHARES",
    "times T by which torques shift": "gap.predictors.torque:DELAYS",
    "deviations of links": "robots.consistent:STRETCH_SD",
    "usual offset": "gap.causes.log.torque_offset:USUAL",
    "usual error of a gain": "gap.causes.log.torque_scale:USUAL",
    "usual payload": "gap.causes.body.payload:USUAL_SHARE",
    "usual mass of a wrong link": "gap.causes.body.link_parameters:MASS_SD",
    "noise of accelerations": "gap.signals.spectra:ACCURATE",
    "harmonics within the band": "gap.signals.spectra:HARMONICS",
    "presliding distances that are tried": "gap.signals.friction_state:PRESLIDING_DISTANCES",
}
"""Where each number is, by what it is."""
FACTORS = 0.5, 2.0
HIDDEN = (0, 8, 10, 12, 21, 24)
"""Cases of the first round of `blind_logs`: four causes, none, and two at once."""
REAL = (
    "Panda, two runs",
    "LBR Med 7",
    "Kinova Gen3, opti2",
    "UR10",
    "LWA 4P, masses guessed",
    "KR 300",
)


@contextmanager
def changed(place: str, factor: float) -> Iterator[None]:
    """Multiply a constant in its module, and in those that import it, for a while."""
    path, _, name = place.partition(":")
    value = getattr(import_module(f"stiction_envs.{path}"), name)
    new = tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value
    modules = [m for m in list(sys.modules.values()) if getattr(m, name, None) is value]
    for module in modules:
        setattr(module, name, new)
    try:
        yield
    finally:
        for module in modules:
            setattr(module, name, value)


@cache
def hidden_cases() -> list[tuple[blind_logs.Job, HiddenLogs]]:
    """Return the cases of `HIDDEN`, simulated."""
    jobs = blind_logs.plan(1, 0.03)
    return [(jobs[k], jobs[k].case()) for k in HIDDEN]


def measure(job: tuple[str, float]) -> Row:
    """Return of each case the names and the error with a changed constant; "" changes none."""
    place, factor = job
    listed = tomllib.loads((Path(every_log.__file__).with_suffix(".toml")).read_text("utf-8"))
    real = {x["name"]: {**x, "folder": str(MEASURED.parent)} for x in listed["log"]}
    cases, out = hidden_cases(), {}
    with changed(place, factor) if place else nullcontext():
        for row in (blind_logs.judged(*case) for case in cases):
            out[f"{row['seed']} {' '.join(row['hidden'])}"] = {
                "right": row["named"][: len(row["expected"])] == row["expected"]
                or (len(row["expected"]) > 1 and blind_logs.all_named(row)),
                "inside": list(row["inside"].values()),
                "error": float(np.mean(row["second"]["extended_nm"])),
            }
        for name in REAL:
            row = every_log.measure(real[name])
            out[name] = {"names": row["names"], "error": float(np.mean(row["ours"]))}
    return {"cases": out}


def error(row: Row, today: Row, real: bool) -> float:
    """Return the change of the error, geometric mean over real or simulated logs [-]."""
    logs = [k for k in row if (k in REAL) == real]
    return float(np.exp(np.mean([np.log(row[k]["error"] / today[k]["error"]) for k in logs])) - 1)


def right(row: Row) -> int:
    """Return in how many simulated logs the hidden causes are named."""
    return sum(x["right"] for k, x in row.items() if k not in REAL)


def words(row: Row, today: Row) -> list[str]:
    """Return what is said of a variant: hidden causes, intervals, names and error of real logs."""
    inside = [ok for k, x in row.items() if k not in REAL for ok in x["inside"]]
    other = sum(set(row[k]["names"]) != set(today[k]["names"]) for k in REAL)
    hidden, real = (f"{100 * error(row, today, of):+.1f} %" for of in (False, True))
    return [f"{right(row)}, {sum(inside)}/{len(inside)}, {hidden}", f"{other or 'no'}, {real}"]


def page(rows: dict[str, Row]) -> dict[str, Any]:
    """Return the values of the page."""
    cases = {key: row["cases"] for key, row in rows.items()}
    today, lines = cases.pop("today"), []
    for what, place in CONSTANTS.items():
        path, _, name = place.partition(":")
        value = getattr(import_module(f"stiction_envs.{path}"), name)
        shown = ", ".join(f"{x:.3g}" for x in dict.fromkeys(np.ravel(value).tolist()))
        each = [x for f in FACTORS for x in words(cases[f"{place} {f:g}"], today)]
        lines.append([what, f"`{path.rpartition('.')[2]}.{name}`", shown, *each])
    head = ["number", "constant", "today", "half: hidden", "real", "double: hidden", "real"]
    changes = {key: 100 * error(row, today, True) for key, row in cases.items()}
    worst = max(changes, key=lambda key: changes[key]).rpartition(" ")[0]
    return {
        "table": table_text(head, lines),
        "today": words(today, today),
        "now": right(today),
        "least": min(map(right, cases.values())),
        "low": f"{min(changes.values()):+.0f}",
        "high": f"{max(changes.values()):+.0f}",
        "worst": next(what for what, place in CONSTANTS.items() if place == worst),
        "count": len(CONSTANTS),
        "cases": len(HIDDEN),
        "logs": len(REAL),
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    jobs: dict[str, tuple[str, float]] = {"today": ("", 1.0)}
    jobs |= {f"{place} {f:g}": (place, f) for place in CONSTANTS.values() for f in FACTORS}
    how = {"processes": options.processes, "minutes": options.minutes}
    rows = STUDY.rows(options).fill(jobs, measure, **how)
    if len(rows) == len(jobs):
        STUDY.write_page(options, **page(rows))


if __name__ == "__main__":
    main()
