"""Page of `policies`: tables of its results; the words are in ``policies.md.j2``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from benchmarks.learning.policies_pictures import draw_behaviour, draw_curves, draw_pareto
from benchmarks.learning.policies_plan import (
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

SJE = TRAINED[SJE_ALGORITHM]


def page(results: Results, folder: Path) -> dict[str, Any]:
    """Draw the pictures into a folder; return what the page's template asks for."""
    draw_curves(folder / "policies_curves.png", results)
    draw_pareto(folder / "policies_pareto.png", results)
    behaviour = draw_behaviour(folder / "policies_behaviour.png", results)
    constant, rule = results.rivals()
    pairs = ((results.learned, constant), (results.learned, rule), (rule, constant))
    duels = {
        (pair, f): results.against(results.cell("panda", RANDOM_PATHS, f), *pair)
        for pair in pairs
        for f in results.plan.frictions
    }
    on_ramps = {
        ((SJE, theirs), NOMINAL): results.against(results.cell("panda", "ramps"), SJE, theirs)
        for theirs in results.rivals("ramps")
    }
    over = results.improvements(results.cell("panda", RANDOM_PATHS))
    return {
        "small": results.plan == SMALL,
        "plan": results.plan,
        "learned": results.learned,
        "constant": duels[pairs[0], NOMINAL],
        "rule": duels[pairs[1], NOMINAL],
        "duels": _duels(duels),
        "ramps": _duels(on_ramps),
        "aim": AIM,
        "bound": BOUND,
        "reached": [name for name, found in over.items() if found.meets_aim and name != BOUND],
        "improvements": _improvements(over),
        "behaviour": behaviour,
        "sections": _sections(results),
        "trainings": len(results.trained),
        "by_earlier_code": results.by_earlier_code,
        "frictions": [f for f in results.plan.frictions if f != NOMINAL],
        "baselines": BASELINES,
        "trained": TRAINED,
        "from_a_table": [TRAINED[algorithm] for algorithm in FROM_A_TABLE],
        "searched": SEARCHED,
        "sje": SJE,
        "agents": agent_settings(),
        "lever": load_gte_protocol().vibration_lever,
        "measuring_hours": results.measuring_hours,
        "rates": [f"{name} {rate:.0f}" for name, rate in results.rates.items()],
        "spreads": SPREADS,
        "shaking_weight": SHAKING_WEIGHT,
        "draws": DRAWS,
        "level": LEVEL,
    }


def _range(found: Estimate, measure: Measure) -> str:
    if not math.isfinite(found.value):
        return "–"
    value, low, high = (number(x, measure.digits) for x in found)
    return f"{value} ({low} to {high})"


# ---- tables --------------------------------------------------------------------------------------


def _duels(duels: dict[tuple[tuple[str, str], float], Against]) -> str:
    """Return a table of agents against others, by friction: how much more or less of everything."""
    lines = []
    for (pair, friction), one in duels.items():
        changes = [signed(100 * (x.value - 1), 0) for x in one.ratio.values()]
        ends = [listed(one.unsure) or "–", "yes" if one.beats else "no"]
        lines.append([*pair, f"× {friction:g}", *changes, *ends])
    measures = {key: m for kind in MEASURES.values() for key, m in kind.items()}
    header = [f"{measures[key].label} [%]" for key in next(iter(duels.values())).ratio]
    return table_text(
        ["agent", "against", "friction", *header, "not significant", "beats it"], lines
    )


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
        runs, lost = sum(len(results.episodes.runs(x)) for x in ones), results.truncated(cell, name)
        trained = f", {runs} of {results.plan.runs} trained" if ones[0].run is not None else ""
        found = [_range(results.estimate(cell, name, key), m) for key, m in measures.items()]
        lines.append([name + trained + (f", {lost} truncated" if lost else ""), *found])
    header = [m.label + (f" [{m.unit}]" if m.unit != "1" else "") for m in measures.values()]
    return table_text(["agent", *header], lines)


def _frictions(results: Results, cell: Cell) -> str:
    """Return a table: errors and vibration at rest, or torque and oscillation, by friction."""
    keys = (*ERRORS, "at_rest") if cell.experiment == "gte" else ("torque", "oscillation")
    frictions = [f for f in results.plan.frictions if f != NOMINAL]
    there = [results.cell(cell.robot, cell.task, f) for f in frictions]
    pairs = [(c, key, MEASURES[cell.experiment][key]) for c in there for key in keys]
    lines = [
        [name, *(_range(results.estimate(c, name, key), m) for c, key, m in pairs)]
        for name in results.by_cell[cell]
    ]
    return table_text(["agent", *(f"× {c.friction:g}: {m.label}" for c, _, m in pairs)], lines)
