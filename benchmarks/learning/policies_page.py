"""Page of `policies`: tables of its results; the words are in ``policies.md.j2``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from benchmarks.learning.policies_pictures import draw_behaviour, draw_curves, draw_pareto
from benchmarks.learning.policies_plan import (
    ALGORITHMS,
    BASELINES,
    BOUND,
    FROM_A_TABLE,
    NOMINAL,
    RANDOM_PATHS,
    SEARCHED,
    SHAKING_WEIGHT,
    SJE_ALGORITHM,
    SMALL,
    SPREADS,
    TRAINED,
    Cell,
    title,
)
from benchmarks.learning.policies_results import (
    AIM,
    ERRORS,
    MEASURES,
    VIBRATIONS,
    Against,
    Measure,
    Results,
)
from benchmarks.learning.policies_statistics import DRAWS, LEVEL, Estimate
from stiction_envs.envs.agents import agent_settings
from stiction_envs.experiments.gte.protocol import load_gte_protocol
from stiction_envs.reporting.markdown import listed, number, signed, table_text

NONE, NO_DITHER = "none", ("none", BOUND, "feedforward", "push")
"""Agents that do not dither."""
LATE = 1 / 3
"""Share of a training, its last, whose rise of the return is on the page."""
WORDS = {
    "position": "position error",
    "orientation": "orientation error",
    "moving": "vibration moving",
    "at_rest": "at rest",
    "torque": "breakaway torque",
    "oscillation": "oscillation",
}


def page(results: Results, folder: Path) -> dict[str, Any]:
    """Draw the pictures into a folder; return what the page's template asks for."""
    draw_curves(folder / "policies_curves.png", results)
    draw_pareto(folder / "policies_pareto.png", results)
    behaviour = draw_behaviour(folder / "policies_behaviour.png", results)
    constant, rule = results.rivals()
    duels = {
        "constant": results.duels(results.learned, constant),
        "learned": results.duels(results.learned, rule),
        "rule": results.duels(rule, constant),
    }
    nominal = {theirs: duels[theirs][NOMINAL] for theirs in duels}
    cell = results.cell("panda", RANDOM_PATHS)
    shaking = [name for name in results.by_cell[cell] if name not in NO_DITHER]
    over = results.improvements(cell)
    return {
        "small": results.plan == SMALL,
        "plan": results.plan,
        "trainings": len(results.trained),
        "by_earlier_code": results.by_earlier_code,
        "learned": results.learned,
        "constant": nominal["constant"],
        "rule": nominal["learned"],
        "duel_table": _duels(duels),
        "turned": [
            (one, friction)
            for theirs in ("constant", "learned")
            for friction, one in duels[theirs].items()
            if one.beats != nominal[theirs].beats
        ],
        "moved": max(
            abs(one.less(key) - duels[theirs][NOMINAL].less(key))
            for theirs in ("constant", "learned")
            for one in duels[theirs].values()
            for key in (*one.wanted, *one.prices)
        ),
        "ramps": [
            results.duels(TRAINED[SJE_ALGORITHM], theirs, "ramps")[NOMINAL]
            for theirs in results.rivals("ramps")
        ],
        "rises": {TRAINED[x]: results.rise(x, LATE) for x in ALGORITHMS},
        "most": {
            key: max(results.against(cell, name, NONE).less(key) for name in shaking)
            for key in ERRORS
        },
        "bounded": {key: results.against(cell, BOUND, NONE).less(key) for key in ERRORS},
        "says": _says,
        "frictions": [f for f in results.plan.frictions if f != NOMINAL],
        "aim": AIM,
        "bound": BOUND,
        "over": over,
        "reached": [name for name, found in over.items() if found.meets_aim and name != BOUND],
        "improvements": _improvements(over),
        "baseline": BASELINES["panda"],
        "baselines": BASELINES,
        "trained": TRAINED,
        "from_a_table": [TRAINED[algorithm] for algorithm in FROM_A_TABLE],
        "searched": SEARCHED,
        "sje": SJE_ALGORITHM,
        "agents": agent_settings(),
        "lever": load_gte_protocol().vibration_lever,
        "sections": _sections(results),
        "behaviour": behaviour,
        "measuring_hours": results.measuring_hours,
        "rates": [
            f"{TRAINED[algorithm]} {rate:.0f} ({experiment.upper()})"
            for (experiment, algorithm), rate in results.rates.items()
        ],
        "spreads": SPREADS,
        "shaking_weight": SHAKING_WEIGHT,
        "draws": DRAWS,
        "level": LEVEL,
    }


def _says(found: Against) -> str:
    """Return what one agent does against another: less or more, of everything."""

    def change(key: str) -> str:
        less = round(found.less(key))
        return f"{abs(less)} % {'less' if less > 0 else 'more'}" if less else "as much"

    wanted = " and ".join(f"{change(key)} {WORDS[key]}" for key in found.wanted)
    prices = " and ".join(f"{change(key)} {WORDS[key]}" for key in found.prices)
    unsure = f" (not significant: {listed(found.unsure)})" if found.unsure else ""
    return f"{wanted}{unsure}, with {prices}"


def _range(found: Estimate, measure: Measure) -> str:
    if not math.isfinite(found.value):
        return "–"
    value, low, high = (number(x, measure.digits) for x in (found.value, found.low, found.high))
    return f"{value} ({low} to {high})"


# ---- tables --------------------------------------------------------------------------------------


def _duels(duels: dict[str, dict[float, Against]]) -> str:
    """Return a table: the learned policy against its rivals, and they each other, by friction."""
    lines = []
    for rivals in duels.values():
        for friction, one in rivals.items():
            keys = (*one.wanted, *one.prices)
            changes = [signed(-one.less(key), 0) for key in keys]
            verdict = "yes" if one.beats else "no"
            lines.append(
                [
                    one.ours,
                    one.theirs,
                    f"× {friction:g}",
                    *changes,
                    listed(one.unsure) or "–",
                    verdict,
                ]
            )
    header = ["agent", "against", "friction"]
    header += [f"{WORDS[key]} [%]" for key in (*ERRORS, *VIBRATIONS)]
    return table_text([*header, "not significant", "beats it"], lines)


def _improvements(over: dict[str, Against]) -> str:
    """Return a table: every agent against Table 4.9 on the random paths."""
    lines = []
    for name, found in over.items():
        cells = [name]
        for key in ERRORS:
            r = found.ratio[key]
            less = [number(100 * (1 - x), 0) for x in (r.value, r.high, r.low)]
            cells.append(f"{less[0]} ({less[1]} to {less[2]})")
        cells += [number(found.ratio[key].value, 2) for key in VIBRATIONS]
        for key in ERRORS:
            p = found.improvement[key]
            cells.append(f"{p.value:.2f} ({p.low:.2f} to {p.high:.2f})")
        lines.append([*cells, "met" if found.meets_aim else "missed"])
    header = ["agent", *(f"less {key} error left [%]" for key in ERRORS)]
    header += ["vibration moving, ratio", "at rest, ratio"]
    header += [f"P(improvement), {key}" for key in ERRORS]
    return table_text([*header, "aim"], lines)


def _sections(results: Results) -> dict[str, dict[str, str]]:
    """Return tables by title: everything at the nominal friction, then what friction changes."""
    return {
        f"{title(cell.robot)}, {cell.task}": {
            "nominal": _nominal(results, cell),
            "others": _frictions(results, cell),
        }
        for cell in results.by_cell
        if cell.friction == NOMINAL
    }


def _nominal(results: Results, cell: Cell) -> str:
    measures = MEASURES[cell.experiment]
    lines = []
    for name, ones in results.by_cell[cell].items():
        runs = sum(len(results.episodes.runs(one)) for one in ones)
        lost = results.truncated(cell, name)
        shown = name + (
            f", {runs} of {results.plan.runs} trained" if ones[0].run is not None else ""
        )
        shown += f", {lost} truncated" if lost else ""
        found = [_range(results.estimate(cell, name, key), m) for key, m in measures.items()]
        lines.append([shown, *found])
    header = [m.label + (f" [{m.unit}]" if m.unit != "1" else "") for m in measures.values()]
    return table_text(["agent", *header], lines)


def _frictions(results: Results, cell: Cell) -> str:
    """Return a table: errors and vibration at rest, or torque and oscillation, by friction."""
    keys = (*ERRORS, "at_rest") if cell.experiment == "gte" else ("torque", "oscillation")
    measures = MEASURES[cell.experiment]
    there = [results.cell(cell.robot, cell.task, f) for f in results.plan.frictions if f != NOMINAL]
    lines = [
        [
            name,
            *(
                _range(results.estimate(other, name, key), measures[key])
                for other in there
                for key in keys
            ),
        ]
        for name in results.by_cell[cell]
    ]
    header = [f"× {c.friction:g}: {measures[key].label}" for c in there for key in keys]
    return table_text(["agent", *header], lines)
