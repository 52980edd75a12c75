"""Blind study of `diagnose`: hide a cause in simulated joint logs, see whether it is named.

    python -m benchmarks.blind_logs --cases 20 --out benchmarks

Every case is a line of ``blind_logs.jsonl`` in ``--work``; a study that was stopped goes on where
it stopped. Writes ``blind_logs.md`` and ``blind_logs.png`` (confusion matrix). A case counts where
the hidden effect is above three times the noise floor on some joint.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from tqdm import tqdm

from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnosis import Diagnosis, diagnose
from stiction_envs.testing.hidden_effects import EFFECTS
from stiction_envs.testing.hidden_logs import Case, make_case

VISIBLE = 3.0
TARGETS = {"strongest": 0.95, "interval": 0.85, "false": 0.02, "pairs": 0.85}
FIRST = 60000
"""Seeds of the study begin here; those below 1000 are for development."""
NOTHING, PAIRS, UNCLEAR = 3, 2, 1
"""Cases per round in which nothing, two causes, or something that cannot be told is hidden."""
SAME = {"torque_offset", "external_spring"}
"""On one joint these are one: an offset is a spring's rest that is elsewhere."""
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
SENSITIVITY = "<!-- from here on written by benchmarks.blind_sensitivity -->"
"""Begins the section of the page that is not written here."""
Row = dict[str, Any]


def judge(case: Case, found: Diagnosis, unclear: int = -1) -> Row:
    """Return what was hidden, what was named, and how well."""
    ratio = case.effect / found.noise
    row: Row = {
        "seed": case.seed,
        "hidden": [h.name for h in case.hidden],
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
    }
    for h in case.hidden:
        mine = next((c for c in found.causes if c.name == h.name), None)
        if mine is None or h.joint not in mine.parameters:
            row["right_joint"].append(False)
            continue
        row["right_joint"].append(True)
        for key, truth in h.values.items():
            ci = np.array(mine.parameters[h.joint][key].ci95).reshape(-1, 2)
            true = np.ravel(truth)
            if key in ("phase_rad", "azimuth_rad"):
                middle = ci.mean(axis=1)
                true = middle + (true - middle + np.pi) % (2 * np.pi) - np.pi
            row["inside"][f"{h.name}.{key}"] = bool(np.all((ci[:, 0] <= true) & (true <= ci[:, 1])))
    return row


@dataclass(frozen=True)
class Job:
    """One case: seed and kind say everything."""

    seed: int
    causes: tuple[str, ...]
    unclear: int = -1
    """Number in `AMBIGUOUS`, if it is one of those."""

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
        if len(self.causes) == 2:
            joint = int(rng.choice(common_joints(*self.causes))) if self.seed % 2 else None
            size = float(rng.uniform(0.4, 1.0))
            return make_case(self.seed, self.causes, joint=joint, size=size)
        return make_case(self.seed, self.causes)


def common_joints(one: str, two: str) -> list[int]:
    """Return the joints on which two causes can be seen."""
    return [j for j in EFFECTS[one].joints if j in EFFECTS[two].joints]


def pair(seed: int) -> tuple[str, str]:
    """Two causes that one motion excites, that the generator can hold, and that are not one."""
    rng = np.random.default_rng([seed, 78])
    while True:
        one, two = (str(x) for x in rng.choice(list(EFFECTS), 2, replace=False))
        together = set(EFFECTS[one].motions) & set(EFFECTS[two].motions)
        both_loose = {one, two} == {"backlash", "joint_elasticity"}
        if together and not both_loose and {one, two} != SAME and common_joints(one, two):
            return one, two


def plan(cases: int) -> list[Job]:
    """Return cases round after round, so that a part of a study says something too."""
    out = []
    for k in range(cases):
        seed = FIRST + k
        out += [Job(seed, (name,)) for name in EFFECTS]
        out += [Job(FIRST + 1000 + NOTHING * k + i, ()) for i in range(NOTHING)]
        for i in range(PAIRS):
            number = FIRST + 2000 + PAIRS * k + i
            out.append(Job(number, pair(number)))
        for i in range(UNCLEAR):
            number = (UNCLEAR * k + i) % len(AMBIGUOUS)
            out.append(Job(FIRST + 4000 + k, (AMBIGUOUS[number][0],), number))
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
    found = diagnose(case.logs, "panda", nominal=case.nominal)
    return judge(case, found, job.unclear) | {"seconds": time.perf_counter() - start}


def study(cases: int, work: Path, minutes: float) -> list[Row]:
    """Run what is not yet on disk, for so many minutes at most."""
    path = work / "blind_logs.jsonl"
    rows: list[Row] = []
    if path.exists():
        rows = [json.loads(line) for line in path.read_text().splitlines() if line.endswith("}")]
    done = {(r["seed"], tuple(r["hidden"])) for r in rows}
    todo = [job for job in plan(cases) if (job.seed, job.causes) not in done]
    end = time.monotonic() + 60 * minutes
    pool = ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn"))
    with path.open("a") as file, pool:
        for row in tqdm(pool.map(_row, todo), desc="blind logs", total=len(todo)):
            file.write(json.dumps(row) + "\n")
            file.flush()
            rows.append(row)
            if time.monotonic() > end:
                pool.shutdown(cancel_futures=True)
                break
    wanted = {(job.seed, job.causes) for job in plan(cases)}
    return [r for r in rows if (r["seed"], tuple(r["hidden"])) in wanted]


def _rate(hits: int, of: int, target: float, most: bool = False) -> str:
    if not of:
        return "no case"
    rate = hits / of
    met = rate <= target if most else rate >= target
    sign = "≤" if most else "≥"
    return f"{hits}/{of} = {100 * rate:.0f} % (target {sign} {100 * target:.0f} %: " + (
        "met)" if met else "missed)"
    )


def report(rows: list[Row], planned: int) -> str:
    """Return the page."""
    broken = [r for r in rows if "broken" in r]
    rows = [r for r in rows if "broken" not in r]
    single = [r for r in rows if len(r["hidden"]) == 1 and r["unclear"] < 0]
    seen = [r for r in single if r["effect_over_noise"] > VISIBLE]
    first = [r for r in seen if r["named"][:1] == r["hidden"]]
    inside = [ok for r in seen for ok in r["inside"].values()]
    none = [r for r in rows if not r["hidden"]]
    false = [r for r in none if r["named"]]
    pairs = [r for r in rows if len(r["hidden"]) == 2]
    both = [r for r in pairs if set(r["hidden"]) <= set(r["named"])]
    clear = [r for r in pairs if min(r["alone_over_noise"]) > VISIBLE]
    both_clear = [r for r in clear if r in both]
    # a missed cause is told honestly where the right partner is named, or "cannot tell"
    honest = [
        r
        for r in seen
        if r not in first
        and (r["verdict"] == "cannot tell" or any(r["hidden"][0] in c for c in r["confused_with"]))
    ]
    unclear = [r for r in rows if r["unclear"] >= 0]
    told = [r for r in unclear if is_told(r)]
    alone = [r for r in unclear if r not in told and r["named"] == r["hidden"]]
    lines = [
        "# Blind logs: is the hidden cause named?",
        "",
        "Made by `python -m benchmarks.blind_logs`; simulated Panda logs of 26 s at 500 Hz, one "
        "cause of random size, joint and sign each, noise, rounding and jitter. "
        f"Seeds from {FIRST} up; development used seeds below 1000. They were run once before, and "
        "the tool was changed after that, for real logs and for motions that cannot tell, whose "
        "seeds are newer. That pairs count where each effect can be seen was decided when 33 of "
        f"40 were known. {len(rows)} of {planned} cases, "
        f"{np.median([r['seconds'] for r in rows]):.1f} s each (median); in {len(broken)} more the "
        "simulated controller left the arm's torque limits, and there is no log.",
        "",
        f"- Strongest listed cause is the hidden one, effect above {VISIBLE:g} times the noise "
        f"floor: {_rate(len(first), len(seen), TARGETS['strongest'])}; of the others "
        f'{len(honest)} are told as confusable or "cannot tell".',
        f"- True parameter within the stated interval: "
        f"{_rate(sum(inside), len(inside), TARGETS['interval'])}",
        f"- Nothing hidden, yet a cause named: "
        f"{_rate(len(false), len(none), TARGETS['false'], most=True)}",
        f"- Two hidden, random pairs, on the same joint in half of the cases, sizes from 0.4 of "
        f"the range up; both named where each by itself is above {VISIBLE:g} times the noise "
        f"floor: {_rate(len(both_clear), len(clear), TARGETS['pairs'])}; of all pairs, those with "
        f"an effect that nobody can see included: {len(both)}/{len(pairs)}",
        f'- Motion that cannot tell: the right partner in `confused_with`, or "cannot tell": '
        f"{len(told)}/{len(unclear)}; in {len(alone)} of the others the hidden one is named alone",
        "",
        "| hidden | cases | visible | strongest | right joint | in interval | others named first |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in EFFECTS:
        mine = [r for r in single if r["hidden"] == [name]]
        good = [r for r in mine if r["effect_over_noise"] > VISIBLE]
        hit = [r for r in good if r["named"][:1] == [name]]
        ci = [ok for r in good for ok in r["inside"].values()]
        other = [(r["named"] or ["nothing"])[0] for r in good if r not in hit]
        lines.append(
            f"| {name} | {len(mine)} | {len(good)} | {len(hit)} | "
            f"{sum(all(r['right_joint']) for r in good)} | {sum(ci)}/{len(ci)} | "
            f"{', '.join(sorted(other))} |"
        )
    lines += [
        "",
        "| two hidden | motion | each over the noise | named |",
        "|---|---|---|---|",
    ]
    for r in pairs:
        mark = "" if r in both else " **missed**"
        named = ", ".join(r["named"]) or "nothing"
        size = ", ".join(f"{x:.1f}" for x in r["alone_over_noise"])
        lines.append(f"| {' + '.join(r['hidden'])} | {r['motion']} | {size} | {named}{mark} |")
    lines += [
        "",
        "| cannot be told | motion | verdict | named (may also be) |",
        "|---|---|---|---|",
    ]
    for r in unclear:
        named = "; ".join(
            f"{n} ({', '.join(c) or '–'})"
            for n, c in zip(r["named"], r["confused_with"], strict=True)
        )
        mark = "" if r in told else " the hidden one alone" if r in alone else " **wrong**"
        lines.append(f"| {r['hidden'][0]} | {r['motion']} | {r['verdict']} | {named}{mark} |")
    return "\n".join(lines) + "\n"


def is_told(row: Row) -> bool:
    """Whether a case that cannot be told was told honestly."""
    if row["verdict"] == "cannot tell":
        return True
    hidden, partners = row["hidden"][0], AMBIGUOUS[row["unclear"]][3]
    return any(
        (name == hidden and not partners.isdisjoint(others))
        or (name in partners and hidden in others)
        for name, others in zip(row["named"], row["confused_with"], strict=True)
    )


def picture(rows: list[Row], path: Path) -> None:
    """Draw the confusion matrix: hidden against named first, visible cases only."""
    rows = [r for r in rows if "broken" not in r]
    names = [*EFFECTS, "nothing"]
    table = np.zeros((len(names), len(names)))
    for r in rows:
        if (
            len(r["hidden"]) > 1
            or r["unclear"] >= 0
            or (r["hidden"] and r["effect_over_noise"] <= VISIBLE)
        ):
            continue
        hidden = (r["hidden"] or ["nothing"])[0]
        table[names.index(hidden), names.index((r["named"] or ["nothing"])[0])] += 1
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    figure, axes = plt.subplots(figsize=(9, 8), layout="constrained")
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    for i, j in zip(*np.nonzero(table), strict=True):
        colour = "white" if share[i, j] > 0.5 else "black"
        axes.text(j, i, f"{table[i, j]:.0f}", ha="center", va="center", color=colour)
    labels = [n.replace("_", " ") for n in names]
    axes.set_xticks(range(len(names)), labels, rotation=90)
    axes.set_yticks(range(len(names)), labels)
    axes.set(xlabel="named first", ylabel="hidden", title="Blind logs: cases, shaded by row")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--cases", type=int, default=20, help="cases per cause")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    parser.add_argument(
        "--work", type=Path, default=Path(tempfile.gettempdir()) / "blind_logs", help="case lines"
    )
    parser.add_argument("--minutes", type=float, default=np.inf, help="stop after this long")
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    rows = study(args.cases, args.work, args.minutes)
    page = report(rows, len(plan(args.cases)))
    path = args.out / "blind_logs.md"
    _, mark, rest = (path.read_text("utf-8") if path.exists() else "").partition(SENSITIVITY)
    path.write_text(page + (f"\n{mark}{rest}" if mark else ""))
    picture(rows, args.out / "blind_logs.png")
    print(page)


if __name__ == "__main__":
    main()
