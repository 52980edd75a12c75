"""The page of `treatments`: which one leaves least error in which condition, then all numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.harness import Row, machine
from benchmarks.learning.treatments_plan import Condition
from stiction_envs.control.laws import LAWS
from stiction_envs.reporting.markdown import table_text
from tuning.settings import tuning_settings

STILL_M = 1e-6
"""What swings less than this has no frequency."""
SWINGS_M = 1e-3
"""A treatment that swings by more at rest hunts, and is not recommended; assumed."""
NOTHING, DITHER = "nothing", "dither"


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
    return ", ".join(words)


def page(rows: Mapping[Condition, Row], planned: int) -> dict[str, Any]:
    """Return what the page's template asks for: the answer, and a table per condition."""
    winners = {c: best(row) for c, row in rows.items()}
    wins = Counter(winners.values()).most_common()
    dither = [c for c, name in winners.items() if name == DITHER]
    aim = [
        c
        for c, row in rows.items()
        if max(row[winners[c]]["position_left"], row[winners[c]]["orientation_left"]) <= 0.3
    ]
    return {
        "wins": [f"{name} in {count}" for name, count in wins],
        "measured": len(rows),
        "planned": planned,
        "dither_wins": len(dither),
        "aim": len(aim),
        "best": _best_table(rows, winners),
        "tables": [(title(c), _table(row)) for c, row in rows.items()],
        "needs": [(name, law.knows) for name, law in LAWS.items()],
        "machine": machine(),
        "swings_mm": 1e3 * SWINGS_M,
        "margin_mm": 1e3 * tuning_settings().search.rest_margin,
    }


def _best_table(rows: Mapping[Condition, Row], winners: Mapping[Condition, str]) -> str:
    header = ["condition", "best", "left [%]", "at rest [mm]", "a hand feels [N/m]"]
    header += ["dither: left [%]", "at rest [mm]", "nothing: at rest [mm]", "a hand feels [N/m]"]
    lines = []
    for c, row in rows.items():
        one, dither, nothing = row[winners[c]], row[DITHER], row[NOTHING]
        lines.append(
            [
                title(c),
                winners[c],
                _left(one),
                f"{1e3 * one['vibration_at_rest_m']:.3f}",
                f"{one['push_n_per_m']:.0f}",
                _left(dither),
                f"{1e3 * dither['vibration_at_rest_m']:.3f}",
                f"{1e3 * nothing['vibration_at_rest_m']:.3f}",
                f"{nothing['push_n_per_m']:.0f}",
            ]
        )
    return table_text(header, lines)


def _left(m: Mapping[str, float]) -> str:
    return f"{100 * m['position_left']:.0f} / {100 * m['orientation_left']:.0f}"


def _table(row: Row) -> str:
    header = ["treatment", "position left [%]", "orientation left [%]", "vibration [mm]"]
    header += ["at rest [mm]", "torque rate [N·m/s]", "creeps [mm/s]", "swings [mm]", "at [Hz]"]
    header += ["push [N/m]"]
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
                f"{1e3 * m['creep_m_s']:.4f}",
                f"{1e3 * m['hold_m']:.4f}",
                f"{m['hold_hz']:.1f}" if m["hold_m"] > STILL_M else "–",
                f"{m['push_n_per_m']:.0f}",
            ]
            for name, m in row.items()
            if name != "seconds"
        ],
    )
