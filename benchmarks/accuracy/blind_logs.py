"""Blind study of `diagnose`: hide causes in simulated joint logs, see whether they are named.

    python -m benchmarks.accuracy.blind_logs --cases 20
    python -m benchmarks.accuracy.blind_logs --cases 20 --scatter 0.03   (a column of the page)

What counts was fixed before the seeds from `FIRST` on were run:

*Visible.* Each hidden effect by itself, simulated alone along the same motion, changes the torque
of some joint by more than three times that joint's noise floor (root mean square of means over
50 ms). Of a link's wrong mass and centre, only what base parameters show counts. Of a smooth torque
over the angle, only what is no straight line over the angles that the joint visits counts: a line
is a spring or an offset. Effects that are not visible are listed and not counted.

*Holds on a second motion.* Another kind of motion of the same arm with the same things hidden, of
which the diagnosis knows nothing: the error of the extended model there, root mean square at the
cutoff of the first log, over that on held-out blocks of the first, mean over joints, is below
`HOLDS`. All visible cases count, wrongly named ones too. A second motion may be harder in itself
(rests, whose friction nobody knows). So the same error is also given over what the true model of an
arm in which nothing is hidden leaves there, where that is more than the error on held-out blocks.

*Links off.* With ``--scatter`` every link of the simulated arm differs from what its makers know
(`hidden.worlds.scattered`), and that is not hidden: where nothing else is, a name is
false. What is visible is judged by the hidden cause alone.
"""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import LOGS, Benchmark, Row, met
from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.signals.dataset import assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.validation.check import check_model
from stiction_envs.hidden.hidden_logs import Hidden, HiddenLogs, make_case
from stiction_envs.hidden.torque_effects import EFFECTS, cause_of
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_full

FIRST = 80000
"""Seeds of the study begin here; those below 1000 are for development."""
NOTHING, PAIRS, TRIPLES = 3, 2, 1
"""Cases per round in which nothing, two causes, or three are hidden; assumed."""
SECOND = 16.0
"""Length of the log of the second motion [s]; assumed."""
SCATTERS = (0.0, 0.03, 0.1)
"""How far every link is off [-]; one column each."""
BODIES = {"payload", "link_parameters"}
"""Causes that say that a body differs."""
VISIBLE = 3.0
"""Times the noise floor from which on an effect counts [-]; assumed."""
HOLDS = 1.3
"""Error on the second motion over that on held-out blocks of the first, at most [-]; assumed."""
STRONGEST, INTERVAL, FALSE, TWO, THREE, HOLD = 0.95, 0.85, 0.02, 0.9, 0.8, 0.95
"""Shares of cases that are aimed at [-]; assumed."""
MADE_BY = (*LOGS, "stiction_envs/hidden", "benchmarks/accuracy/blind_logs.py")
"""Code that decides a case."""
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)


# ---- cases ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Job:
    """One case: seed and kind say everything."""

    seed: int
    causes: tuple[str, ...]
    scatter: float = 0.0
    """How far every link is off [-]."""

    @property
    def key(self) -> str:
        """Key of the case's row."""
        off = f", links {self.scatter:g} off" if self.scatter else ""
        return f"{self.seed} {' '.join(self.causes)}{off}"

    def case(self) -> HiddenLogs:
        """Simulate it."""
        rng = np.random.default_rng([self.seed, 77])
        make = partial(make_case, self.seed, scatter=self.scatter)
        if len(self.causes) > 1:
            same = len(self.causes) == 2 and self.seed % 2
            where = int(rng.choice(common_joints(*self.causes))) if same else None
            size = float(rng.uniform(0.4, 1.0))
            return make(self.causes, joint=where, size=size, second=SECOND)
        return make(self.causes, second=SECOND)


def common_joints(one: str, two: str) -> list[int]:
    """Return the joints on which two effects are visible."""
    return [j for j in EFFECTS[one].joints if j in EFFECTS[two].joints]


def together(*names: str) -> bool:
    """Whether one motion excites some effects, and the generator and a log can hold them all."""
    motions = set.intersection(*(set(EFFECTS[x].motions) for x in names))
    pairs = [
        two not in EFFECTS[one].excludes and bool(common_joints(one, two))
        for one, two in combinations(names, 2)
    ]
    return bool(motions) and all(pairs)


def some(seed: int, count: int) -> tuple[str, ...]:
    """Return so many effects that can be hidden `together`."""
    rng = np.random.default_rng([seed, 76 + count])
    while True:
        names = tuple(str(x) for x in rng.choice(list(EFFECTS), count, replace=False))
        if together(*names):
            return names


def plan(cases: int, scatter: float = 0.0) -> list[Job]:
    """Return cases round after round, so that a part of a study says something too."""
    out = []
    for k in range(cases):
        out += [Job(FIRST + k, (name,)) for name in EFFECTS]
        out += [Job(FIRST + 1000 + NOTHING * k + i, ()) for i in range(NOTHING)]
        for start, each, count in ((2000, PAIRS, 2), (3000, TRIPLES, 3)):
            seeds = [FIRST + start + each * k + i for i in range(each)]
            out += [Job(seed, some(seed, count)) for seed in seeds]
    return [replace(job, scatter=scatter) for job in out]


def row_of(job: Job) -> Row:
    """Run one case.

    No log is made if the controller shakes an arm (a soft joint) beyond its torque limits.
    """
    try:
        case = job.case()
    except StictionError as error:
        return {"seed": job.seed, "hidden": list(job.causes), "broken": str(error)}
    return judged(job, case)


def judged(job: Job, case: HiddenLogs) -> Row:
    """Diagnose a case."""
    start = time.perf_counter()
    found = diagnose_logs(case.logs, case.robot, nominal=case.nominal)
    row: Row = {
        "seconds": time.perf_counter() - start,
        "seed": case.seed,
        "hidden": list(job.causes),
        "expected": [h.name for h in case.hidden],
        "motion": case.motion,
        "alone_over_noise": [float((x / found.noise).max()) for x in case.alone],
        "verdict": found.verdict,
        "named": [c.name for c in found.causes],
        "joints": [list(c.joints) for c in found.causes],
        "right_joint": [estimates_of(found, h) is not None for h in case.hidden],
        "inside": {k: ok for h in case.hidden for k, ok in inside(found, h).items()},
        "held_out_nm": found.extended_rms.tolist(),
    }
    if case.second:
        row["second"] = {"motion": case.second_motion} | second(case, found)
    return row


def estimates_of(found: Diagnosis, hidden: Hidden) -> Any:
    """Return what was found of a hidden cause where it is: on its joint, or of its link."""
    mine = next((c for c in found.causes if c.name == hidden.name), None)
    if mine is None:
        return None
    if "link" not in hidden.values:
        return mine.parameters.get(hidden.joint)
    of_link = [p for p in mine.parameters.values() if p["link"].value == hidden.values["link"]]
    return of_link[0] if of_link else None


def inside(found: Diagnosis, hidden: Hidden) -> dict[str, bool]:
    """Return which true values of a hidden cause lie in their intervals."""
    mine, out = estimates_of(found, hidden), {}
    for key, truth in hidden.values.items() if mine is not None else ():
        if key == "link":
            continue
        ci = np.array(mine[key].ci95).reshape(-1, 2)
        true = np.ravel(truth).astype(float)
        # of a curve with fewer or more coefficients the others are zero
        size = max(len(ci), len(true))
        ci = np.pad(ci, ((0, size - len(ci)), (0, 0)))
        true = np.pad(true, (0, size - len(true)))
        if key in ("phase_rad", "azimuth_rad"):
            middle = ci.mean(axis=1)
            true = middle + (true - middle + np.pi) % (2 * np.pi) - np.pi
        out[f"{hidden.name}.{key}"] = bool(np.all((ci[:, 0] <= true) & (true <= ci[:, 1])))
    return out


def second(case: HiddenLogs, found: Diagnosis) -> Row:
    """Return (7,) errors on the second motion [N·m]: of the extended model, and of the truth."""
    friction = None if isinstance(case.nominal, str) else case.nominal
    signals = prepare(case.unhidden, cutoff_hz=found.data.recording.cutoff)
    truth = assemble(case.bare.rigid, signals, friction=friction)
    left = np.sqrt(np.square(truth.tau - truth.nominal).mean(axis=0))
    extended = check_model(found, case.second).extended_rms
    return {"extended_nm": extended.tolist(), "truth_nm": left.tolist()}


# ---- what is said of a row -----------------------------------------------------------------------


def visible(row: Row) -> bool:
    """Return whether everything that is hidden is visible."""
    return min(row["alone_over_noise"], default=np.inf) > VISIBLE


def transfer(row: Row, truth: bool = False) -> float:
    """Return the error on the second motion over that on held-out blocks, mean over joints.

    With ``truth`` over what the true model leaves on the second motion, where that is more.
    """
    best = np.array(row["held_out_nm"])
    if truth:
        best = np.maximum(best, row["second"]["truth_nm"])
    return float(np.mean(row["second"]["extended_nm"] / best))


def first(row: Row) -> bool:
    """Return whether the strongest listed cause is the hidden one."""
    return bool(row["named"][:1] == row["expected"])


def all_named(row: Row) -> bool:
    """Return whether everything that is hidden is named."""
    return set(row["expected"]) <= set(row["named"])


def names_body(row: Row) -> bool:
    """Return whether a body is named."""
    return not BODIES.isdisjoint(row["named"])


def line(row: Row) -> str:
    """Return a case in a line."""
    hidden = " + ".join(row["hidden"]) or "nothing"
    sizes = ", ".join(f"{x:.1f}" for x in row["alone_over_noise"])
    named = ", ".join(f"{n} {j}" for n, j in zip(row["named"], row["joints"], strict=True))
    out = f"{row['seed']} {hidden} ({row['motion']}; {sizes} over the noise): {named or 'nothing'}"
    if "second" in row:
        ratios = transfer(row), transfer(row, truth=True)
        out += f"; {row['second']['motion']}: {ratios[0]:.2f}, over the truth {ratios[1]:.2f}"
    outside = ", ".join(k for k, ok in row["inside"].items() if not ok)
    return out + f"; not in its interval: {outside}" * bool(outside)


# ---- the page ------------------------------------------------------------------------------------


class Rows:
    """The rows of cases whose links are equally far off, by what was hidden."""

    def __init__(self, rows: list[Row]) -> None:
        self.whole = [r for r in rows if "broken" not in r]
        self.none, self.single, self.pairs, self.triples = (
            [r for r in self.whole if len(r["hidden"]) == k] for k in range(4)
        )
        self.seen = [r for r in self.single if visible(r)]
        # another cause is named first, or none, where one or nothing is hidden
        self.wrong = [
            r
            for r in self.whole
            if (r in self.seen and not first(r)) or (r in self.none and r["named"])
        ]
        self.held = [r for r in self.whole if "second" in r and r["hidden"] and visible(r)]


def scores(rows: Rows) -> dict[str, tuple[float | None, list[bool]]]:
    """Return what is scored: the share that is aimed at, and which cases reach it."""
    no_body = [r for r in rows.whole if r["hidden"] and BODIES.isdisjoint(r["expected"])]
    return {
        "one cause is hidden: the strongest named is the hidden one": (
            STRONGEST,
            [first(r) for r in rows.seen],
        ),
        "the true parameter is within its interval": (
            INTERVAL,
            [ok for r in rows.seen for ok in r["inside"].values()],
        ),
        "nothing is hidden, yet a cause is named": (FALSE, [bool(r["named"]) for r in rows.none]),
        "the same, a body (payload or link)": (None, [names_body(r) for r in rows.none]),
        "causes are hidden, but no body, yet one is named": (
            None,
            [names_body(r) for r in no_body],
        ),
        "two causes are hidden, and all are named": (
            TWO,
            [all_named(r) for r in rows.pairs if visible(r)],
        ),
        "the same, with all pairs": (None, [all_named(r) for r in rows.pairs]),
        "three causes are hidden, and all are named": (
            THREE,
            [all_named(r) for r in rows.triples if visible(r)],
        ),
        "the same, with all triples": (None, [all_named(r) for r in rows.triples]),
        "the model holds on a second motion": (HOLD, [transfer(r) < HOLDS for r in rows.held]),
        "the same, over what the true model leaves there": (
            HOLD,
            [transfer(r, truth=True) < HOLDS for r in rows.held],
        ),
    }


def rate(hits: list[bool], target: float | None = None) -> str:
    """Return how many cases hit, and whether the share misses its target."""
    if not hits:
        return "–"
    share = sum(hits) / len(hits)
    text = f"{sum(hits)}/{len(hits)} = {100 * share:.0f} %"
    missed = target is not None and met(share, target, most=target == FALSE) == "missed"
    return f"{text} **missed**" if missed else text


def scores_table(rows: Mapping[float, Rows]) -> str:
    """Return the table of `scores`: a column for each distance by which links are off."""
    found = {off: scores(some) for off, some in rows.items() if some.whole}
    titles = [f"links {100 * x:g} % and {100 * x:g} mm off" if x else "links known" for x in found]
    lines = []
    for text, (target, _) in next(iter(found.values()), {}).items():
        sign = "≤" if target == FALSE else "≥"
        aim = f"{sign} {100 * target:.0f} %" if target else ""
        lines.append([text, aim, *(rate(mine[text][1], target) for mine in found.values())])
    return table_text(["", "target", *titles], lines)


def page(by_scatter: Mapping[float, list[Row]]) -> dict[str, Any]:
    """Return what the page's template asks for, from rows by how far the links are off."""
    every = {x: Rows(rows) for x, rows in by_scatter.items()}
    rows = every[0.0]
    missed = [r for r in rows.held if transfer(r, truth=True) >= HOLDS]
    return {
        "cases": len(rows.whole),
        "broken": len(by_scatter[0.0]) - len(rows.whole),
        "seconds": float(np.median([r["seconds"] for r in rows.whole])),
        "visible": VISIBLE,
        "holds": HOLDS,
        "strongest": rate([first(r) for r in rows.seen]),
        "scores": scores_table(every),
        "links_off": [
            f"{line(r)}, links {x:g} off" for x, some in every.items() if x for r in some.wrong
        ],
        "missed": [line(r) for r in sorted(missed, key=transfer, reverse=True)],
        "by_cause": _by_cause(rows.single),
        "together": _together([*rows.pairs, *rows.triples]),
    }


def _by_cause(single: list[Row]) -> str:
    lines = []
    for name in EFFECTS:
        mine = [r for r in single if r["hidden"] == [name]]
        good = [r for r in mine if visible(r)]
        ci = [ok for r in good for ok in r["inside"].values()]
        held = [transfer(r, truth=True) for r in good if "second" in r]
        other = [(r["named"] or ["nothing"])[0] for r in good if not first(r)]
        right = sum(all(r["right_joint"]) for r in good)
        counts = (len(mine), len(good), sum(map(first, good)), right)
        ends = (f"{np.median(held):.2f}" if held else "", ", ".join(sorted(other)))
        lines.append([name, *map(str, counts), f"{sum(ci)}/{len(ci)}", *ends])
    header = ["hidden", "cases", "visible", "strongest", "right joint or link", "in interval"]
    return table_text([*header, "second motion (median)", "others named first"], lines)


def _together(rows: list[Row]) -> str:
    lines = []
    for r in rows:
        mark = "" if all_named(r) else " **missed**" if visible(r) else " (not visible)"
        size = ", ".join(f"{x:.1f}" for x in r["alone_over_noise"])
        named = (", ".join(r["named"]) or "nothing") + mark
        ratio = f"{transfer(r, truth=True):.2f}"
        lines.append([" + ".join(r["hidden"]), r["motion"], size, named, ratio])
    header = ["hidden together", "motion", "each over the noise", "named", "second motion"]
    return table_text(header, lines)


def draw(rows: Rows, path: Path) -> None:
    """Draw the confusion matrix: hidden against named first, visible cases only."""
    hidden = [*EFFECTS, "nothing"]
    named = list(dict.fromkeys([*map(cause_of, EFFECTS), "nothing"]))
    named += sorted({r["named"][0] for r in rows.seen if r["named"]} - set(named))
    table = np.zeros((len(hidden), len(named)))
    for r in (*rows.seen, *rows.none):
        at = hidden.index((r["hidden"] or ["nothing"])[0])
        table[at, named.index((r["named"] or ["nothing"])[0])] += 1
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    figure = Figure(figsize=(9.5, 9), layout="constrained")
    axes = figure.subplots()
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    for i, j in zip(*np.nonzero(table), strict=True):
        colour = "white" if share[i, j] > 0.5 else "black"
        axes.text(j, i, f"{table[i, j]:.0f}", ha="center", va="center", color=colour)
    axes.set_xticks(range(len(named)), [n.replace("_", " ") for n in named], rotation=90)
    axes.set_yticks(range(len(hidden)), [n.replace("_", " ") for n in hidden])
    axes.set(xlabel="named first", ylabel="hidden", title="Blind logs: cases, shaded by row")
    save_full(figure, path)


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--cases", type=int, default=20, help="cases per cause")
    parser.add_argument(
        "--scatter", type=float, default=0.0, help="how far every link is off, 0.03: 3 %% and 3 mm"
    )
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    options = parser.parse_args()
    jobs, kept = plan(options.cases, options.scatter), STUDY.rows(options)
    kept.fill(
        {job.key: job for job in jobs},
        row_of,
        processes=options.processes,
        minutes=options.minutes,
    )
    keys = {x: [job.key for job in plan(options.cases, x)] for x in SCATTERS}
    rows = {x: list(kept.known(of).values()) for x, of in keys.items()}
    STUDY.write_page(options, first=FIRST, planned=len(jobs), **page(rows))
    draw(Rows(rows[0.0]), options.out / "blind_logs.png")


if __name__ == "__main__":
    main()
