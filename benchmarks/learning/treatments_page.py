"""The page of `treatments`: which one leaves least error in which condition, then all numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import Row, machine
from benchmarks.learning.treatments_plan import PENTAGON, ROBOTS, Condition, Places
from stiction_envs.control.laws import LAWS
from stiction_envs.reporting.markdown import table_text
from stiction_envs.reporting.png import save_full
from tuning.settings import tuning_settings

STILL_M = 1e-6
"""What swings less than this has no frequency."""
SWINGS_M = 1e-3
"""A treatment that swings by more at rest hunts, and is not recommended; assumed."""
AIM = 0.3
"""Share of the error that the best treatment is to leave at most [-]."""
DRAWS = 2000
"""Of a bootstrap; assumed."""
NOTHING, DITHER, SEARCHED = "nothing", "dither", ", searched"


def left(numbers: Mapping[str, float]) -> float:
    """Return the error left, geometric mean of position and orientation [-]."""
    return float(np.sqrt(numbers["position_left"] * numbers["orientation_left"]))


def allowed(row: Row) -> dict[str, Mapping[str, float]]:
    """Return treatments that may be recommended: they neither shake nor hunt at rest.

    They shake at rest by no more than nothing does and the tuner's margin.
    """
    named = {name: m for name, m in row.items() if name != "seconds"}
    most = named[NOTHING]["vibration_at_rest_m"] + tuning_settings().search.rest_margin
    return {
        name: m
        for name, m in named.items()
        if m["vibration_at_rest_m"] <= most and m["hold_m"] <= SWINGS_M and left(m) < np.inf
    }


def best(row: Row) -> str:
    """Return the name of the allowed treatment that leaves least error."""
    listed = allowed(row)
    return min(listed, key=lambda name: left(listed[name]))


def title(c: Condition) -> str:
    """Return the words for a condition."""
    words = [c.robot, f"{c.stiffness[0]:g} N/m"]
    wrong = 100 * (1 / c.friction - 1)
    words.append("friction known" if abs(wrong) < 1e-9 else f"friction believed {wrong:+.0f} %")
    if c.delay_ms is None:
        words.append("ideal senses")
    else:
        words += [f"senses {c.delay_ms:g} ms late", f"noise × {c.noise:.2g}"]
    if c.load_kg:
        words.append(f"{c.load_kg:g} kg that nobody told")
    return ", ".join(words)


def interval(m: Mapping[str, Any]) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of the error left, paths drawn anew [-]."""
    logs = np.asarray(m["left_by_path"])
    drawn = np.random.default_rng(0).choice(logs, size=(DRAWS, len(logs))).mean(axis=1)
    low, high = np.exp(np.percentile(drawn, [2.5, 97.5]))
    return float(low), float(high)


def page(rows: Mapping[Condition, Row], planned: int) -> dict[str, Any]:
    """Return what the page's template asks for: the answer, and a table per condition."""
    winners = {c: best(row) for c, row in rows.items()}
    wins = Counter(winners.values()).most_common()
    dither = [c for c, name in winners.items() if name == DITHER]
    aim = {c for c, row in rows.items() if _most(row[winners[c]]) <= AIM}
    robots = {c.robot: [d for d in rows if d.robot == c.robot] for c in rows}
    return {
        "aims": [
            f"{len(aim & {*own})} of {len(own)} on the {name}" for name, own in robots.items()
        ],
        "wins": [f"{name} in {count}" for name, count in wins],
        "measured": len(rows),
        "planned": planned,
        "dither_wins": len(dither),
        "best": _best_table(rows, winners),
        "tables": [(title(c), _table(row)) for c, row in rows.items()],
        "needs": [(name, law.knows) for name, law in LAWS.items()],
        "machine": machine(),
        "swings_mm": 1e3 * SWINGS_M,
        "margin_mm": 1e3 * tuning_settings().search.rest_margin,
    }


def searched_page(
    judged: Mapping[tuple[Condition, Places], Row], runs: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return what the template says of gains that were searched; nothing without any.

    Args:
        judged: rows on random paths and on the pentagon.
        runs: arguments of the searches.
    """
    random = {c: (places, row) for (c, places), row in judged.items() if places != PENTAGON}
    if not random:
        return {}
    answer: list[str] = []
    best_of, tables = [], []
    for c, (_, row) in random.items():
        default, whole = (
            best({k: m for k, m in row.items() if some or not k.endswith(SEARCHED)})
            for some in (False, True)
        )
        line = [title(c)]
        for name in (default, whole):
            line += [name, _left(row[name]), _interval(row[name])]
        answer.append(f"{_left(row[whole])} % ({title(c)}: {whole})")
        enough = [name for name, m in allowed(row).items() if _most(m) <= AIM]
        best_of.append([*line, "; ".join(enough) or "none"])
        tables.append((title(c), _searched_table(row, judged.get((c, PENTAGON), {}))))
    header = ["condition", "best of the defaults", "left [%]", "both [%]"]
    header += ["best of all", "left [%]", "both [%]", f"at most {100 * AIM:g} % of each by"]
    return {
        "trials": sorted({run["evaluations"] for run in runs}),
        "robots": [name for name in ROBOTS if name in {c.robot for c in random}],
        "missing": [name for name in ROBOTS if name not in {c.robot for c in random}],
        "paths": max(len(places.names) for places, _ in random.values()),
        "pentagons": PENTAGON.iterations,
        "answer": answer,
        "best": table_text(header, best_of),
        "tables": tables,
    }


def _searched_table(row: Row, pentagon: Row) -> str:
    """Return defaults beside what was searched: error left on both, and what they do at rest."""
    header = ["treatment", "random paths: left [%]", "both [%]", "pentagon: left [%]"]
    header += ["at rest [mm]", "swings [mm]", "torque rate [N·m/s]"]
    lines = []
    for name, m in row.items():
        if name == "seconds":
            continue
        line = [name, _left(m), _interval(m), _left(pentagon[name]) if pentagon else "–"]
        line += [f"{1e3 * m[k]:.3f}" for k in ("vibration_at_rest_m", "hold_m")]
        lines.append([*line, f"{m['torque_rate_nm_s']:.0f}"])
    return table_text(header, lines)


def _best_table(rows: Mapping[Condition, Row], winners: Mapping[Condition, str]) -> str:
    header = ["condition", "best", "left [%]", "both [%]", "shakes at rest [mm]"]
    header += ["still off [mm]", "a hand feels [N/m]", "dither: left [%]", "shakes at rest [mm]"]
    header += ["nothing: shakes at rest [mm]", "still off [mm]", "a hand feels [N/m]"]
    lines = []
    for c, row in rows.items():
        one, dither, nothing = row[winners[c]], row[DITHER], row[NOTHING]
        lines.append(
            [
                title(c),
                winners[c],
                _left(one),
                _interval(one),
                f"{1e3 * one['vibration_at_rest_m']:.3f}",
                f"{1e3 * one['rest_error_m']:.1f}",
                f"{one['push_n_per_m']:.0f}",
                _left(dither),
                f"{1e3 * dither['vibration_at_rest_m']:.3f}",
                f"{1e3 * nothing['vibration_at_rest_m']:.3f}",
                f"{1e3 * nothing['rest_error_m']:.1f}",
                f"{nothing['push_n_per_m']:.0f}",
            ]
        )
    return table_text(header, lines)


def _most(m: Mapping[str, float]) -> float:
    return max(m["position_left"], m["orientation_left"])


def draw(rows: Mapping[Condition, Row], path: Path) -> None:
    """Draw error left against vibration of every treatment, a field per robot, 200 N/m, 1 ms late.

    Sizes of points are noise levels.
    """
    shown = {c: r for c, r in rows.items() if c.delay_ms == 1.0 and c.friction == 1.0}
    shown = {c: r for c, r in shown.items() if c.stiffness[0] == 200.0 and not c.load_kg}
    robots = list(dict.fromkeys(c.robot for c in shown))
    figure = Figure(figsize=(4.2 * max(len(robots), 1) + 2.2, 4.2), layout="constrained")
    for k, robot in enumerate(robots):
        axes = figure.add_subplot(1, len(robots), k + 1)
        own = sorted((c for c in shown if c.robot == robot), key=lambda c: c.noise)
        for j, name in enumerate(n for n in shown[own[0]] if n != "seconds"):
            marks = [shown[c][name] for c in own]
            x, y = ([f(m) for m in marks] for f in (_rest_mm, lambda m: 100 * left(m)))
            size = [14 + 26 * i for i in range(len(own))]
            axes.scatter(x, y, s=size, color=f"C{j % 10}", marker="os"[j // 10], label=name)
        axes.set(title=robot, xlabel="vibration at rest [mm]")
        axes.axhline(30, color="0.7", linewidth=1, zorder=0)
        axes.set(xlim=(0, None), ylim=(0, 130))
        if k == 0:
            axes.set_ylabel("error left at goals [%]")
    if robots:
        figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    save_full(figure, path)


def _rest_mm(m: Mapping[str, float]) -> float:
    return 1e3 * m["vibration_at_rest_m"]


def _interval(m: Mapping[str, Any]) -> str:
    low, high = interval(m)
    return f"{100 * left(m):.0f} ({100 * low:.0f} to {100 * high:.0f})"


def _left(m: Mapping[str, float]) -> str:
    return f"{100 * m['position_left']:.0f} / {100 * m['orientation_left']:.0f}"


def _table(row: Row) -> str:
    header = ["treatment", "position left [%]", "orientation left [%]", "vibration [mm]"]
    header += ["at rest [mm]", "torque rate [N·m/s]", "still off [mm]", "creeps [mm/s]"]
    header += ["swings [mm]", "at [Hz]", "push [N/m]"]
    return table_text(
        header,
        [
            [
                name,
                f"{100 * m['position_left']:.0f}",
                f"{100 * m['orientation_left']:.0f}",
                f"{1e3 * m['vibration_m']:.4f}",
                f"{1e3 * m['vibration_at_rest_m']:.4f}",
                f"{m['torque_rate_nm_s']:.0f}",
                f"{1e3 * m['rest_error_m']:.2f}",
                f"{1e3 * m['creep_m_s']:.4f}",
                f"{1e3 * m['hold_m']:.4f}",
                f"{m['hold_hz']:.1f}" if m["hold_m"] > STILL_M else "–",
                f"{m['push_n_per_m']:.0f}",
            ]
            for name, m in row.items()
            if name != "seconds"
        ],
    )
