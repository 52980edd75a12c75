"""The page of `blind_logs`: shares against targets, every case that was missed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.harness import Row, met
from stiction_envs.hidden.torque_effects import EFFECTS, cause_of
from stiction_envs.reporting.markdown import table_text

SCATTERS = (0.0, 0.03, 0.1)
"""How far every link is off [-]; one column each."""
BODIES = {"payload", "link_parameters"}
"""Causes that say that a body differs."""
VISIBLE = 3.0
"""Times the noise floor from which on an effect counts [-]; assumed."""
HOLDS = 1.3
"""Error on the second motion over that on held-out blocks of the first, at most [-]; assumed."""
TARGETS = {
    "strongest": 0.95,
    "interval": 0.85,
    "false": 0.02,
    "pairs": 0.9,
    "triples": 0.8,
    "second": 0.95,
}
"""Shares of cases that are aimed at [-]; assumed."""
Hits = list[bool]


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


def _rate(hits: Hits, target: str = "") -> str:
    if not hits:
        return "–"
    rate = sum(hits) / len(hits)
    text = f"{sum(hits)}/{len(hits)} = {100 * rate:.0f} %"
    most = target == "false"
    missed = bool(target) and met(rate, TARGETS[target], most=most) == "missed"
    return f"{text} **missed**" if missed else text


def whole(rows: list[Row]) -> list[Row]:
    """Return the rows of cases of which there is a log."""
    return [r for r in rows if "broken" not in r]


def _clear(rows: list[Row]) -> list[Row]:
    return [r for r in whole(rows) if r["unclear"] < 0]


def _held(rows: list[Row]) -> list[Row]:
    return [r for r in _clear(rows) if "second" in r and r["hidden"] and visible(r)]


def scores(rows: list[Row], is_honest: Callable[[Row], bool]) -> dict[str, tuple[str, Hits]]:
    """Return what is scored, and for each the name of its target and which cases reach it.

    Args:
        rows: of cases whose links are equally far off.
        is_honest: whether the ambiguity of an ambiguous case is named.
    """
    none, single, pairs, triples = (
        [r for r in _clear(rows) if len(r["hidden"]) == k] for k in range(4)
    )
    seen = [r for r in single if visible(r)]
    held = _held(rows)
    inside = [ok for r in seen for ok in r["inside"].values()]
    no_body = [r for r in _clear(rows) if r["hidden"] and BODIES.isdisjoint(r["expected"])]
    unclear = [is_honest(r) for r in whole(rows) if r["unclear"] >= 0]
    out = {
        "one cause is hidden: the strongest named is the hidden one": (
            "strongest",
            [first(r) for r in seen],
        ),
        "the true parameter is within its interval": ("interval", inside),
        "nothing is hidden, yet a cause is named": ("false", [bool(r["named"]) for r in none]),
        "the same, a body (payload or link)": ("", [names_body(r) for r in none]),
        "causes are hidden, but no body, yet one is named": ("", [names_body(r) for r in no_body]),
    }
    for count, many, target in (("two", pairs, "pairs"), ("three", triples, "triples")):
        named = [all_named(r) for r in many if visible(r)]
        out[f"{count} causes are hidden, and all are named"] = target, named
        out[f"the same, with all {target}"] = "", [all_named(r) for r in many]
    return out | {
        "an ambiguity is named, or the verdict is cannot tell": ("", unclear),
        "the model holds on a second motion": ("second", [transfer(r) < HOLDS for r in held]),
        "the same, over what the true model leaves there": (
            "second",
            [transfer(r, truth=True) < HOLDS for r in held],
        ),
    }


def scores_table(rows: Mapping[float, list[Row]], is_honest: Callable[[Row], bool]) -> str:
    """Return the table of `scores`: a column for each distance by which links are off."""
    found = {off: scores(some, is_honest) for off, some in rows.items() if some}
    titles = {off: f"links {100 * off:g} % and {100 * off:g} mm off" for off in found}
    lines = []
    for text, (target, _) in next(iter(found.values()), {}).items():
        sign = "≤" if target == "false" else "≥"
        aim = f"{sign} {100 * TARGETS[target]:.0f} %" if target else ""
        lines.append([text, aim, *(_rate(mine[text][1], target) for mine in found.values())])
    return table_text(["", "target", *(titles[x] if x else "links known" for x in found)], lines)


def page(rows: Mapping[float, list[Row]], is_honest: Callable[[Row], bool]) -> dict[str, Any]:
    """Return what the page's template asks for.

    Args:
        rows: of the cases, by how far their links are off.
        is_honest: whether the ambiguity of an ambiguous case is named.
    """
    known = whole(rows[0.0])
    clear = _clear(known)
    missed = [r for r in _held(known) if transfer(r, truth=True) >= HOLDS]
    many = [r for r in clear if len(r["hidden"]) > 1]
    return {
        "cases": len(known),
        "broken": len(rows[0.0]) - len(known),
        "seconds": float(np.median([r["seconds"] for r in known])),
        "visible": VISIBLE,
        "holds": HOLDS,
        "strongest": _rate([first(r) for r in clear if len(r["hidden"]) == 1 and visible(r)]),
        "scores": scores_table(rows, is_honest),
        "links_off": [
            f"{line(r)}, links {x:g} off" for x, some in rows.items() if x for r in _wrong(some)
        ],
        "missed": [line(r) for r in sorted(missed, key=transfer, reverse=True)],
        "by_cause": _by_cause([r for r in clear if len(r["hidden"]) == 1]),
        "together": _together(sorted(many, key=lambda r: len(r["hidden"]))),
        "unclear": _unclear([r for r in known if r["unclear"] >= 0], is_honest),
    }


def _wrong(rows: list[Row]) -> list[Row]:
    """Return the cases of one visible cause or none in which another is named first, or none is."""

    def wrong(row: Row) -> bool:
        single = len(row["hidden"]) == 1 and visible(row)
        return single and not first(row) if row["hidden"] else bool(row["named"])

    return [r for r in _clear(rows) if wrong(r)]


def _by_cause(single: list[Row]) -> str:
    lines = []
    for name in EFFECTS:
        mine = [r for r in single if r["hidden"] == [name]]
        good = [r for r in mine if visible(r)]
        ci = [ok for r in good for ok in r["inside"].values()]
        held = [transfer(r, truth=True) for r in good if "second" in r]
        other = [(r["named"] or ["nothing"])[0] for r in good if not first(r)]
        counts = (
            len(mine),
            len(good),
            sum(map(first, good)),
            sum(all(r["right_joint"]) for r in good),
        )
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
    return table_text(
        ["hidden together", "motion", "each over the noise", "named", "second motion"], lines
    )


def _unclear(rows: list[Row], is_honest: Callable[[Row], bool]) -> str:
    lines = []
    for r in rows:
        named = "; ".join(
            f"{n} ({', '.join(c) or '–'})"
            for n, c in zip(r["named"], r["confused_with"], strict=True)
        )
        mark = "" if is_honest(r) else " **not said**"
        lines.append([r["hidden"][0], r["motion"], r["verdict"], named + mark])
    return table_text(["ambiguous", "motion", "verdict", "named (may also be)"], lines)


def line(row: Row) -> str:
    """Return a case in a line."""
    hidden = " + ".join(row["hidden"]) or "nothing"
    if "broken" in row:
        return f"{row['seed']} {hidden}: no log"
    sizes = ", ".join(f"{x:.1f}" for x in row["alone_over_noise"])
    named = ", ".join(f"{n} {j}" for n, j in zip(row["named"], row["joints"], strict=True))
    out = f"{row['seed']} {hidden} ({row['motion']}; {sizes} over the noise): {named or 'nothing'}"
    if "second" in row:
        ratios = transfer(row), transfer(row, truth=True)
        out += f"; {row['second']['motion']}: {ratios[0]:.2f}, over the truth {ratios[1]:.2f}"
    inside = ", ".join(k for k, ok in row["inside"].items() if not ok)
    return out + f"; not in its interval: {inside}" * bool(inside)


def draw(rows: list[Row], path: Path) -> None:
    """Draw the confusion matrix: hidden against named first, visible cases only."""
    rows = [r for r in _clear(rows) if len(r["hidden"]) < 2 and visible(r)]
    hidden = [*EFFECTS, "nothing"]
    named = list(dict.fromkeys([*map(cause_of, EFFECTS), "nothing"]))
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
