"""Blind study of `diagnose`: hide causes in simulated joint logs, see whether they are named.

    python -m benchmarks.blind_logs --cases 20 --out benchmarks
    python -m benchmarks.blind_logs --cases 2 --only payload triples --first 100   (no page)

Every case is a line of ``blind_logs.jsonl`` in ``--work`` that knows the code it was made by: a
study that was stopped goes on where it stopped, in parts where ``--only`` names some, and a change
of the code makes the cases anew. Writes ``blind_logs.md`` and a confusion matrix beside it.

What counts was fixed before the seeds from `FIRST` on were run:

*Visible.* Each hidden effect by itself, simulated alone along the same motion, changes the torque
of some joint by more than three times that joint's noise floor (root mean square of means over
50 ms). Of a link's wrong mass and centre that is what base parameters show of them. Of a smooth
torque over the angle only what is no straight line over the angles that the joint visits counts: a
line is a spring or an offset. What nobody can see is listed and not counted.

*Holds on a second motion.* Another kind of motion of the same arm with the same things hidden, of
which the diagnosis knows nothing: the error of the extended model there, root mean square at the
cutoff of the first log, over that on held-out blocks of the first, mean over joints, is below
`HOLDS`. All visible cases count, wrongly named ones too. A second motion may be harder in itself
(rests, whose friction nobody knows): the same is told over what the true model leaves there, of an
arm in which nothing is hidden, where that is more than the error on held-out blocks.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import combinations
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks._blind_logs_page import SENSITIVITY, Row, picture, report, transfer
from benchmarks._made_by import LOGS, PACKAGES, made_by
from stiction_envs.errors import StictionError
from stiction_envs.gap.candidates import certain
from stiction_envs.gap.diagnosis import Diagnosis, diagnose, model_of
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm, load_arm
from stiction_envs.testing.hidden_effects import EFFECTS
from stiction_envs.testing.hidden_logs import Case, Hidden, make_case

FIRST = 80000
"""Seeds of the study begin here; those below 1000 are for development."""
NOTHING, PAIRS, TRIPLES, UNCLEAR = 3, 2, 1, 1
"""Cases per round in which nothing, two causes, three, or what cannot be told is hidden."""
KINDS = ("nothing", "pairs", "triples", "unclear")
SECOND = 16.0
"""Length of the log of the second motion [s]."""
MADE_BY = (*LOGS, "stiction_envs/testing", "benchmarks/blind_logs.py")
"""Code that decides a case."""
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
        found: what was said of it.
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
        return np.sqrt(off).tolist()  # type: ignore[no-any-return]

    data = against(case.second, case.robot)
    truth = against(case.unhidden, load_arm("panda"))
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

    @property
    def kind(self) -> str:
        """Name of its effect, or of `KINDS`."""
        if self.unclear >= 0:
            return "unclear"
        return self.causes[0] if len(self.causes) == 1 else KINDS[max(len(self.causes) - 1, 0)]

    def case(self) -> Case:
        """Simulate it."""
        rng = np.random.default_rng([self.seed, 77])
        if self.unclear >= 0:
            name, motion, joint, _ = AMBIGUOUS[self.unclear]
            known = None if name not in ("coulomb_friction", "viscous_friction") else False
            size = float(rng.uniform(0.4, 1.0))
            return make_case(
                self.seed, (name,), motion=motion, joint=joint or None, known=known, size=size
            )
        if len(self.causes) > 1:
            same = len(self.causes) == 2 and self.seed % 2
            joint = int(rng.choice(common_joints(*self.causes))) if same else None
            size = float(rng.uniform(0.4, 1.0))
            return make_case(self.seed, self.causes, joint=joint, size=size, second=SECOND)
        return make_case(self.seed, self.causes, second=SECOND)


def common_joints(one: str, two: str) -> list[int]:
    """Return the joints on which two causes can be seen."""
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


def _row(job: Job) -> Row:
    """Run one case; `seconds` are those of the diagnosis.

    Of an arm whose controller shook it beyond its torque limits (a soft joint) there is no log.
    """
    try:
        case = job.case()
    except StictionError as error:
        return {"seed": job.seed, "hidden": list(job.causes), "broken": str(error)}
    start = time.perf_counter()
    found = diagnose(case.logs, case.robot, nominal=case.nominal)
    seconds = time.perf_counter() - start
    return judge(case, found, job.causes, job.unclear) | {"seconds": seconds}


def study(jobs: list[Job], work: Path, minutes: float, processes: int) -> list[Row]:
    """Run what is not yet on disk, for so many minutes at most; return the rows of these jobs."""
    path, code = work / "blind_logs.jsonl", made_by(MADE_BY, PACKAGES)
    lines = path.read_text().splitlines() if path.exists() else []
    rows: list[Row] = [json.loads(line) for line in lines if line.endswith("}")]
    rows = [r for r in rows if r.get("code") == code]
    done = {(r["seed"], tuple(r["hidden"])) for r in rows}
    todo = [job for job in jobs if (job.seed, job.causes) not in done] if minutes > 0 else []
    end = time.monotonic() + 60 * minutes
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"))
    with path.open("a") as file, pool:
        for row in tqdm(pool.map(_row, todo), desc="blind logs", total=len(todo)):
            rows.append(row | {"code": code})
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
            if time.monotonic() > end:
                pool.shutdown(cancel_futures=True)
                break
    wanted = {(job.seed, job.causes) for job in jobs}
    return [r for r in rows if (r["seed"], tuple(r["hidden"])) in wanted]


def line(row: Row) -> str:
    """Return a case in a line."""
    hidden = " + ".join(row["hidden"]) or "nothing"
    if "broken" in row:
        return f"{row['seed']} {hidden}: no log"
    sizes = ", ".join(f"{x:.1f}" for x in row["alone_over_noise"])
    named = ", ".join(f"{n} {j}" for n, j in zip(row["named"], row["joints"], strict=True))
    held = ""
    if "second" in row:
        motion, ratios = row["second"]["motion"], (transfer(row), transfer(row, truth=True))
        held = ", second motion ({}) {:.2f}, over the truth {:.2f}".format(motion, *ratios)
    inside = ", ".join(k for k, ok in row["inside"].items() if not ok)
    return (
        f"{row['seed']} {hidden} ({row['motion']}; {sizes} over the noise): {named or 'nothing'}"
        f"{held}, {row['seconds']:.0f} s" + f"; outside: {inside}" * bool(inside)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--cases", type=int, default=20, help="cases per cause")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[*EFFECTS, *KINDS],
        metavar="KIND",
        help=f"effects, or of {', '.join(KINDS)}; cases are listed and no page is written",
    )
    parser.add_argument("--first", type=int, default=FIRST, help="seed; another writes no page")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    parser.add_argument(
        "--work", type=Path, default=Path(tempfile.gettempdir()) / "blind_logs", help="case lines"
    )
    parser.add_argument("--minutes", type=float, default=np.inf, help="stop after this long")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    jobs = [j for j in plan(args.cases, args.first) if not args.only or j.kind in args.only]
    rows = study(jobs, args.work, args.minutes, args.processes)
    if args.only or args.first != FIRST:
        print("\n".join(line(r) for r in rows))
        return
    told = [is_told(r) for r in rows]
    page = report(rows, told, len(jobs), FIRST)
    path = args.out / "blind_logs.md"
    _, mark, rest = (path.read_text("utf-8") if path.exists() else "").partition(SENSITIVITY)
    path.write_text(page + (f"\n{mark}{rest}" if mark else ""))
    picture(rows, args.out / "blind_logs.png")
    print(page)


def is_told(row: Row) -> bool:
    """Whether a case that cannot be told was told honestly."""
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


if __name__ == "__main__":
    main()
