"""The page of `benchmarks.blind_logs`: shares against targets, every case that was missed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from stiction_envs.testing.hidden_effects import EFFECTS

Row = dict[str, Any]
VISIBLE = 3.0
"""Times the noise floor from which on an effect counts."""
HOLDS = 1.3
"""Error on the second motion over that on held-out blocks of the first, at most."""
TARGETS = {
    "strongest": 0.95,
    "interval": 0.85,
    "false": 0.02,
    "pairs": 0.9,
    "triples": 0.8,
    "second": 0.95,
}
SENSITIVITY = "<!-- from here on written by benchmarks.blind_sensitivity -->"
"""Begins the section of the page that is not written here."""


def visible(row: Row) -> bool:
    """Whether everything that is hidden can be seen."""
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
    """Whether the strongest listed cause is the hidden one."""
    return bool(row["named"][:1] == row["expected"])


def all_named(row: Row) -> bool:
    """Whether everything that is hidden is named."""
    return set(row["expected"]) <= set(row["named"])


def _rate(hits: int, of: int, target: float, most: bool = False) -> str:
    if not of:
        return "no case"
    rate = hits / of
    met = rate <= target if most else rate >= target
    sign = "≤" if most else "≥"
    return f"{hits}/{of} = {100 * rate:.0f} % (target {sign} {100 * target:.0f} %: " + (
        "met)" if met else "missed)"
    )


def report(rows: list[Row], told: list[bool], planned: int, seed: int) -> str:
    """Return the page.

    Args:
        rows: of the cases.
        told: (len(rows),) whether a case that cannot be told was told honestly.
        planned: number of cases.
        seed: first of the study.
    """
    honest = {id(r) for r, yes in zip(rows, told, strict=True) if yes}
    broken = [r for r in rows if "broken" in r]
    rows = [r for r in rows if "broken" not in r]
    clear = [r for r in rows if r["unclear"] < 0]
    single, pairs, triples = ([r for r in clear if len(r["hidden"]) == k] for k in (1, 2, 3))
    seen = [r for r in single if visible(r)]
    inside = [ok for r in seen for ok in r["inside"].values()]
    none = [r for r in rows if not r["hidden"]]
    # a missed cause is told honestly where the right partner is named, or "cannot tell"
    fair = [
        r
        for r in seen
        if not first(r)
        and (
            r["verdict"] == "cannot tell" or any(r["expected"][0] in c for c in r["confused_with"])
        )
    ]
    unclear = [r for r in rows if r["unclear"] >= 0]
    alone = [r for r in unclear if id(r) not in honest and r["named"] == r["expected"]]
    lines = [
        "# Blind logs: is what was hidden named, and does the model hold?",
        "",
        "Made by `python -m benchmarks.blind_logs`; simulated Panda logs of 26 s at 500 Hz, "
        "effects of random size, joint and sign, noise, rounding and jitter. "
        f"Seeds from {seed} up; development used seeds below 1000. What counts was fixed before "
        "these seeds were run: the head of `benchmarks/blind_logs.py`. "
        f"{len(rows)} of {planned} cases, "
        f"{np.median([r['seconds'] for r in rows]):.1f} s each (median); in {len(broken)} more the "
        "simulated controller left the arm's torque limits, and there is no log.",
        "",
        f"- Strongest listed cause is the hidden one, effect above {VISIBLE:g} times the noise "
        f"floor: {_rate(sum(map(first, seen)), len(seen), TARGETS['strongest'])}; of the others "
        f'{len(fair)} are told as confusable or "cannot tell".',
        "- True parameter within the stated interval: "
        f"{_rate(sum(inside), len(inside), TARGETS['interval'])}",
        "- Nothing hidden, yet a cause named: "
        f"{_rate(sum(bool(r['named']) for r in none), len(none), TARGETS['false'], most=True)}",
    ]
    for name, many, what in (
        ("pairs", pairs, "Two hidden, random pairs, on the same joint in half of the cases"),
        ("triples", triples, "Three hidden, random, each on a joint of its own drawing"),
    ):
        can = [r for r in many if visible(r)]
        lines.append(
            f"- {what}, sizes from 0.4 of the range up; all named where each by itself is above "
            f"{VISIBLE:g} times the noise floor: "
            f"{_rate(sum(map(all_named, can)), len(can), TARGETS[name])}; of all, those with an "
            f"effect that nobody can see included: {sum(map(all_named, many))}/{len(many)}"
        )
    lines += [
        *_second(clear),
        '- Motion that cannot tell: the right partner in `confused_with`, or "cannot tell": '
        f"{sum(id(r) in honest for r in unclear)}/{len(unclear)}; in {len(alone)} of the others "
        "the hidden one is named alone",
        "",
        "| hidden | cases | visible | strongest | right joint or link | in interval "
        "| second motion (median) | others named first |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in EFFECTS:
        mine = [r for r in single if r["hidden"] == [name]]
        good = [r for r in mine if visible(r)]
        ci = [ok for r in good for ok in r["inside"].values()]
        other = [(r["named"] or ["nothing"])[0] for r in good if not first(r)]
        held = [transfer(r, truth=True) for r in good if "second" in r]
        lines.append(
            f"| {name} | {len(mine)} | {len(good)} | {sum(map(first, good))} | "
            f"{sum(all(r['right_joint']) for r in good)} | {sum(ci)}/{len(ci)} | "
            f"{f'{np.median(held):.2f}' if held else ''} | {', '.join(sorted(other))} |"
        )
    lines += [
        "",
        "| hidden together | motion | each over the noise | named | second motion |",
        "|---|---|---|---|---|",
    ]
    for r in (*pairs, *triples):
        mark = "" if all_named(r) else " **missed**" if visible(r) else " (not visible)"
        named = ", ".join(r["named"]) or "nothing"
        size = ", ".join(f"{x:.1f}" for x in r["alone_over_noise"])
        lines.append(
            f"| {' + '.join(r['hidden'])} | {r['motion']} | {size} | {named}{mark} "
            f"| {transfer(r, truth=True):.2f} |"
        )
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
        mark = " **wrong**"
        if id(r) in honest:
            mark = ""
        elif r in alone:
            mark = " the hidden one alone"
        lines.append(f"| {r['hidden'][0]} | {r['motion']} | {r['verdict']} | {named}{mark} |")
    return "\n".join(lines) + "\n"


def _second(rows: list[Row]) -> list[str]:
    """Return the lines on the second motion."""
    with_it = [r for r in rows if "second" in r]
    seen = [r for r in with_it if r["hidden"] and visible(r)]
    none = [transfer(r) for r in with_it if not r["hidden"]]
    held, true = ([r for r in seen if transfer(r, truth) < HOLDS] for truth in (False, True))
    right = [r for r in seen if all_named(r)]
    of_right = sum(r in true for r in right)
    over = [np.mean(np.divide(r["second"]["extended_nm"], r["second"]["nominal_nm"])) for r in seen]
    lines = [
        "- Error of the extended model on a second motion, of another kind and never used, below "
        f"{HOLDS:g} times that on held-out blocks of the first (mean over joints): "
        f"{_rate(len(held), len(seen), TARGETS['second'])}. Over what the true model leaves there, "
        "where that is more: "
        f"{_rate(len(true), len(seen), TARGETS['second'])}; of the cases with everything named "
        f"{of_right}/{len(right)}."
    ]
    if none and over:
        lines[0] += (
            f" Where nothing is hidden and the model is the true one, the first ratio is "
            f"{np.median(none):.2f} (median; largest {max(none):.2f}): so much is the motion's "
            f"own. Extended over nominal error on the second motion: {np.median(over):.2f} "
            "(median)."
        )
    missed = sorted((r for r in seen if r not in true), key=transfer, reverse=True)
    return lines + [
        f"  - {r['seed']} {' + '.join(r['hidden'])}, {r['motion']} to {r['second']['motion']}: "
        f"{transfer(r):.2f}, over the truth {transfer(r, truth=True):.2f}, named "
        f"{', '.join(r['named']) or 'nothing'}"
        for r in missed
    ]


def picture(rows: list[Row], path: Path) -> None:
    """Draw the confusion matrix: hidden against named first, visible cases only."""
    rows = [r for r in rows if "broken" not in r and r["unclear"] < 0 and len(r["hidden"]) < 2]
    rows = [r for r in rows if visible(r)]
    hidden = [*EFFECTS, "nothing"]
    named = list(dict.fromkeys([*(e.cause for e in EFFECTS.values()), "nothing"]))
    named += sorted({r["named"][0] for r in rows if r["named"]} - set(named))
    table = np.zeros((len(hidden), len(named)))
    for r in rows:
        at = hidden.index((r["hidden"] or ["nothing"])[0])
        table[at, named.index((r["named"] or ["nothing"])[0])] += 1
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    figure, axes = plt.subplots(figsize=(9.5, 9), layout="constrained")
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    for i, j in zip(*np.nonzero(table), strict=True):
        colour = "white" if share[i, j] > 0.5 else "black"
        axes.text(j, i, f"{table[i, j]:.0f}", ha="center", va="center", color=colour)
    axes.set_xticks(range(len(named)), [n.replace("_", " ") for n in named], rotation=90)
    axes.set_yticks(range(len(hidden)), [n.replace("_", " ") for n in hidden])
    axes.set(xlabel="named first", ylabel="hidden", title="Blind logs: cases, shaded by row")
    figure.savefig(path, dpi=120)
    plt.close(figure)
