"""Blind study of `diagnose`: hide a cause in simulated joint logs, see whether it is named.

    python -m benchmarks.blind_logs --cases 20 --out benchmarks

Every case is a line of ``blind_logs.jsonl`` in ``--work``; a study that was stopped goes on where
it stopped. Writes ``blind_logs.md`` and ``blind_logs.png`` (confusion matrix). A case counts where
the hidden effect is above three times the noise floor on some joint.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from tqdm import tqdm

from stiction_envs.gap.logs.diagnosis import Diagnosis, diagnose
from tests.gap.logs.hidden_logs import EXCITED_BY, Case, make_case

VISIBLE = 3.0
TARGETS = {"strongest": 0.95, "interval": 0.85, "false": 0.02, "pairs": 0.85}
PAIRS = (
    ("coulomb_friction", "payload"),
    ("torque_offset", "viscous_friction"),
    ("external_spring", "coulomb_friction"),
    ("base_tilt", "viscous_friction"),
    ("position_dependent_friction", "link_inertia"),
    ("torque_scale", "coulomb_friction"),
)
Row = dict[str, Any]


def judge(case: Case, found: Diagnosis) -> Row:
    """Return what was hidden, what was named, and how well."""
    ratio = case.effect / found.noise
    row: Row = {
        "seed": case.seed,
        "hidden": [h.name for h in case.hidden],
        "motion": case.motion,
        "known": not isinstance(case.nominal, str),
        "effect_over_noise": float(ratio.max()),
        "verdict": found.verdict,
        "named": [c.name for c in found.causes],
        "joints": [list(c.joints) for c in found.causes],
        "gain_percent": [c.gain_percent for c in found.causes],
        "confused_with": [list(c.confused_with) for c in found.causes],
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


def plan(cases: int) -> list[tuple[int, tuple[str, ...]]]:
    """Return (seed, causes), round after round, so that a part of a study says something too."""
    kinds: list[tuple[str, ...]] = [(name,) for name in EXCITED_BY]
    out: list[tuple[int, tuple[str, ...]]] = []
    for k in range(cases):
        seed = 1000 + k
        out += [(seed, kind) for kind in kinds]
        out += [(seed, ()), (seed, PAIRS[k % len(PAIRS)])]
    return out


def study(cases: int, work: Path) -> list[Row]:
    """Run what is not yet on disk."""
    path = work / "blind_logs.jsonl"
    rows: list[Row] = []
    if path.exists():
        rows = [json.loads(line) for line in path.read_text().splitlines() if line.endswith("}")]
    done = {(r["seed"], tuple(r["hidden"])) for r in rows}
    todo = [job for job in plan(cases) if job not in done]
    with path.open("a") as file:
        for seed, causes in tqdm(todo, desc="blind logs"):
            case = make_case(seed, causes)
            start = time.perf_counter()
            found = diagnose(case.logs, "panda", nominal=case.nominal)
            row = judge(case, found) | {"seconds": time.perf_counter() - start}
            file.write(json.dumps(row) + "\n")
            file.flush()
            rows.append(row)
    wanted = set(plan(cases))
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


def report(rows: list[Row]) -> str:
    """Return the page."""
    single = [r for r in rows if len(r["hidden"]) == 1]
    seen = [r for r in single if r["effect_over_noise"] > VISIBLE]
    first = [r for r in seen if r["named"][:1] == r["hidden"]]
    inside = [ok for r in seen for ok in r["inside"].values()]
    none = [r for r in rows if not r["hidden"]]
    false = [r for r in none if r["named"]]
    pairs = [r for r in rows if len(r["hidden"]) == 2]
    both = [r for r in pairs if set(r["hidden"]) <= set(r["named"])]
    # a missed cause is told honestly where the right partner is named, or "cannot tell"
    honest = [
        r
        for r in seen
        if r not in first
        and (r["verdict"] == "cannot tell" or any(r["hidden"][0] in c for c in r["confused_with"]))
    ]
    lines = [
        "# Blind logs: is the hidden cause named?",
        "",
        "Made by `python -m benchmarks.blind_logs`; simulated Panda logs of 26 s at 500 Hz, one "
        "cause of random size, joint and sign each, noise, rounding and jitter. "
        f"{len(rows)} cases, {np.median([r['seconds'] for r in rows]):.1f} s each (median).",
        "",
        f"- Strongest listed cause is the hidden one, effect above {VISIBLE:g} times the noise "
        f"floor: {_rate(len(first), len(seen), TARGETS['strongest'])}; of the others "
        f'{len(honest)} are told as confusable or "cannot tell".',
        f"- True parameter within the stated interval: "
        f"{_rate(sum(inside), len(inside), TARGETS['interval'])}",
        f"- Nothing hidden, yet a cause named: "
        f"{_rate(len(false), len(none), TARGETS['false'], most=True)}",
        f"- Two hidden, both named: {_rate(len(both), len(pairs), TARGETS['pairs'])}",
        "",
        "| hidden | cases | visible | strongest | right joint | in interval | others named first |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in EXCITED_BY:
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
    return "\n".join(lines) + "\n"


def picture(rows: list[Row], path: Path) -> None:
    """Draw the confusion matrix: hidden against named first, visible cases only."""
    names = [*EXCITED_BY, "nothing"]
    table = np.zeros((len(names), len(names)))
    for r in rows:
        if len(r["hidden"]) > 1 or (r["hidden"] and r["effect_over_noise"] <= VISIBLE):
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
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    rows = study(args.cases, args.work)
    page = report(rows)
    (args.out / "blind_logs.md").write_text(page)
    picture(rows, args.out / "blind_logs.png")
    print(page)


if __name__ == "__main__":
    main()
