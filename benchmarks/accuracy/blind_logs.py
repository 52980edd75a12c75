"""Blind study of `diagnose`: hide causes in simulated joint logs, see whether they are named.

    python -m benchmarks.accuracy.blind_logs --cases 20
    python -m benchmarks.accuracy.blind_logs --cases 20 --scatter 0.03   (a column of the page)
    python -m benchmarks.accuracy.blind_logs --only payload triples --first 100   (no page)

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
(`stiction_envs.hidden.imperfect_arms`), and that is not hidden: where nothing else is, a name is
false. What is visible is judged by the hidden cause alone.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from benchmarks.accuracy.blind_logs_page import SCATTERS, draw, line, page
from benchmarks.harness import LOGS, Benchmark, Row
from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs, model_of
from stiction_envs.gap.selection.row_weights import certain
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.hidden.hidden_logs import Case, Hidden, make_case
from stiction_envs.hidden.torque_effects import EFFECTS
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm

FIRST = 80000
"""Seeds of the study begin here; those below 1000 are for development."""
NOTHING, PAIRS, TRIPLES, UNCLEAR = 3, 2, 1, 1
"""Cases per round in which nothing, two causes, three, or what cannot be told is hidden;
assumed."""
KINDS = ("nothing", "pairs", "triples", "unclear")
SECOND = 16.0
"""Length of the log of the second motion [s]; assumed."""
MADE_BY = (*LOGS, "stiction_envs/hidden", "benchmarks/accuracy/blind_logs.py")
"""Code that decides a case."""
STUDY = Benchmark(__file__, __doc__, made_by=MADE_BY)
AMBIGUOUS: tuple[tuple[str, str, int, set[str]], ...] = (
    # hidden, motion, joint (0: any), what else it may be
    ("coulomb_friction", "one_way", 0, {"torque_offset", "direction_asymmetry"}),
    ("torque_offset", "one_way", 0, {"coulomb_friction", "direction_asymmetry"}),
    ("coulomb_friction", "one_speed", 0, {"viscous_friction"}),
    ("viscous_friction", "one_speed", 0, {"coulomb_friction"}),
    ("direction_asymmetry", "fourier", 0, {"torque_offset"}),
    ("load_dependent_friction", "reversals", 2, {"coulomb_friction"}),
    ("torque_offset", "fourier", 0, {"direction_asymmetry", "external_spring"}),
    ("payload", "still", 0, {"torque_offset", "base_tilt"}),
)


def judge(case: Case, found: Diagnosis, hidden: tuple[str, ...] = (), unclear: int = -1) -> Row:
    """Return what was hidden, what was named, and how well.

    Args:
        case: the truth.
        found: the diagnosis.
        hidden: names of the effects; by default those of their causes.
        unclear: number in `AMBIGUOUS`, if it is one of those.
    """
    ratio = case.effect / found.noise
    row: Row = {
        "seed": case.seed,
        "hidden": list(hidden) or [h.name for h in case.hidden],
        "expected": [h.name for h in case.hidden],
        "motion": case.motion,
        "known": not isinstance(case.nominal, str),
        "effect_over_noise": float(ratio.max()),
        "alone_over_noise": [float((x / found.noise).max()) for x in case.alone],
        "verdict": found.verdict,
        "named": [c.name for c in found.causes],
        "joints": [list(c.joints) for c in found.causes],
        "gain_percent": [c.gain_percent for c in found.causes],
        "confused_with": [list(c.confused_with) for c in found.causes],
        "unclear": unclear,
        "right_joint": [],
        "inside": {},
        "nominal_nm": found.nominal_rms.tolist(),
        "held_out_nm": found.extended_rms.tolist(),
        "noise_nm": found.noise.tolist(),
    }
    if case.second:
        row["second"] = {"motion": case.second_motion} | second(case, found)
    for h in case.hidden:
        mine = estimates_of(found, h)
        row["right_joint"].append(mine is not None)
        for key, truth in h.values.items() if mine is not None else ():
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
            row["inside"][f"{h.name}.{key}"] = bool(np.all((ci[:, 0] <= true) & (true <= ci[:, 1])))
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


def second(case: Case, found: Diagnosis) -> Row:
    """Return (7,) errors on the second motion [N·m]: of both models, and of the truth."""
    friction = None if isinstance(case.nominal, str) else case.nominal

    def against(logs: list[JointLog], robot: Arm) -> Data:
        signals = prepare(logs, cutoff_hz=found.data.cutoff, settings=found.settings)
        return assemble(robot, signals, friction=friction, settings=found.settings)

    def rms(data: Data, model: Data) -> list[float]:
        weight = np.stack([certain(data, j) for j in range(data.n)], axis=1)
        weight *= (data.block >= 0)[:, None]
        off = (weight * np.square(data.tau - model.nominal)).sum(axis=0) / weight.sum(axis=0)
        return np.sqrt(off).tolist()

    data = against(case.second, case.robot)
    truth = against(case.unhidden, case.bare.rigid)
    return {
        "nominal_nm": rms(data, data),
        "extended_nm": rms(data, model_of(found).extend(data)),
        "truth_nm": rms(truth, truth),
    }


@dataclass(frozen=True)
class Job:
    """One case: seed and kind say everything."""

    seed: int
    causes: tuple[str, ...]
    unclear: int = -1
    """Number in `AMBIGUOUS`, if it is one of those."""
    scatter: float = 0.0
    """How far every link is off [-]."""

    @property
    def key(self) -> str:
        """Of its row."""
        off = f", links {self.scatter:g} off" if self.scatter else ""
        return f"{self.seed} {' '.join(self.causes)}{off}"

    @property
    def kind(self) -> str:
        """Name of its effect, or of `KINDS`."""
        if self.unclear >= 0:
            return "unclear"
        return self.causes[0] if len(self.causes) == 1 else KINDS[max(len(self.causes) - 1, 0)]

    def case(self) -> Case:
        """Simulate it."""
        rng = np.random.default_rng([self.seed, 77])
        make = partial(make_case, self.seed, scatter=self.scatter)
        if self.unclear >= 0:
            name, motion, joint, _ = AMBIGUOUS[self.unclear]
            known = None if name not in ("coulomb_friction", "viscous_friction") else False
            size = float(rng.uniform(0.4, 1.0))
            return make((name,), motion=motion, joint=joint or None, known=known, size=size)
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
        {one, two} != {"backlash", "joint_elasticity"}
        and two not in EFFECTS[one].excludes
        and bool(common_joints(one, two))
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


def plan(cases: int, first: int = FIRST) -> list[Job]:
    """Return cases round after round, so that a part of a study says something too."""
    out = []
    for k in range(cases):
        out += [Job(first + k, (name,)) for name in EFFECTS]
        out += [Job(first + 1000 + NOTHING * k + i, ()) for i in range(NOTHING)]
        for start, each, count in ((2000, PAIRS, 2), (3000, TRIPLES, 3)):
            seeds = [first + start + each * k + i for i in range(each)]
            out += [Job(seed, some(seed, count)) for seed in seeds]
        for i in range(UNCLEAR):
            number = (UNCLEAR * k + i) % len(AMBIGUOUS)
            out.append(Job(first + 4000 + k, (AMBIGUOUS[number][0],), number))
    return out


def row_of(job: Job) -> Row:
    """Run one case.

    Of an arm whose controller shook it beyond its torque limits (a soft joint) there is no log.
    """
    try:
        case = job.case()
    except StictionError as error:
        return {"seed": job.seed, "hidden": list(job.causes), "broken": str(error)}
    start = time.perf_counter()
    found = diagnose_logs(case.logs, case.robot, nominal=case.nominal)
    seconds = time.perf_counter() - start
    return judge(case, found, job.causes, job.unclear) | {"seconds": seconds}


def is_honest(row: Row) -> bool:
    """Return whether the diagnosis of an ambiguous case names the ambiguity."""
    if row.get("unclear", -1) < 0:
        return False
    if row["verdict"] == "cannot tell":
        return True
    hidden, partners = row["hidden"][0], AMBIGUOUS[row["unclear"]][3]
    return any(
        (name == hidden and not partners.isdisjoint(others))
        or (name in partners and hidden in others)
        for name, others in zip(row["named"], row["confused_with"], strict=True)
    )


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--cases", type=int, default=20, help="cases per cause")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[*EFFECTS, *KINDS],
        metavar="KIND",
        help=f"effects, or of {', '.join(KINDS)}; cases are listed and no page is written",
    )
    parser.add_argument("--first", type=int, default=FIRST, help="seed; another writes no page")
    parser.add_argument(
        "--scatter", type=float, default=0.0, help="how far every link is off, 0.03: 3 %% and 3 mm"
    )
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    options = parser.parse_args()
    jobs = plan(options.cases, options.first)
    here = [
        replace(job, scatter=options.scatter)
        for job in jobs
        if not options.only or job.kind in options.only
    ]
    kept = STUDY.rows(options)
    found = kept.fill(
        {job.key: job for job in here},
        row_of,
        processes=options.processes,
        minutes=options.minutes,
    )
    if options.only or options.scatter or options.first != FIRST:
        print("\n".join(map(line, found.values())))
        return
    keys = {x: [replace(job, scatter=x).key for job in jobs] for x in SCATTERS}
    rows = {x: list(kept.known(of).values()) for x, of in keys.items()}
    STUDY.write_page(options, first=FIRST, planned=len(jobs), **page(rows, is_honest))
    draw(rows[0.0], options.out / "blind_logs.png")


if __name__ == "__main__":
    main()
