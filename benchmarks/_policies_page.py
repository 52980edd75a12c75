"""Page of `policies`: tables of its results; words are in `templates/policies.md.j2`."""

from __future__ import annotations

import math
from pathlib import Path

from benchmarks._policies_measures import MEASURES, Measure
from benchmarks._policies_pictures import draw_behaviour, draw_curves, draw_pareto
from benchmarks._policies_plan import (
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
    episodes_in_all,
    title,
    trainings_in_all,
)
from benchmarks._policies_results import AIM, ERRORS, VIBRATIONS, Against, Results
from benchmarks._policies_statistics import DRAWS, LEVEL, Estimate
from benchmarks._policies_training import TOGETHER
from stiction_envs.envs.agents import agent_settings
from stiction_envs.experiments.gte.protocol import load_gte_protocol
from stiction_envs.reporting.markdown import listed, number, signed, table
from stiction_envs.reporting.templates import write_page

TEMPLATE = Path(__file__).parent / "templates" / "policies.md.j2"
RAMPS, NONE, COMPENSATIONS = "ramps", "none", ("feedforward", "push")
"""Names of the plan."""
LATE = 1 / 3
"""Share of a training, its last, over which it is told how the return still rises."""
CURVES, PARETO, BEHAVIOUR = (f"policies_{x}.png" for x in ("curves", "pareto", "behaviour"))


def write(folder: Path, results: Results) -> None:
    """Write page and pictures.

    Args:
        folder: where to.
        results: of whatever was measured.
    """
    pictures = {
        CURVES: draw_curves(folder / CURVES, results),
        PARETO: draw_pareto(folder / PARETO, results),
    }
    behaviour = draw_behaviour(folder / BEHAVIOUR, results)
    rivals, plan = results.rivals(), results.plan
    duels: dict[str, dict[float, Against]] = {}
    if rivals is not None:
        constant, rule = rivals
        duels["rule"] = results.duels(rule, constant)
        if results.learned is not None:
            duels["constant"] = results.duels(results.learned, constant)
            duels["learned"] = results.duels(results.learned, rule)
    ramps: dict[str, Against] = {}
    if (of := results.rivals(RAMPS)) is not None:
        for kind, theirs in zip(("constant", "rule"), of, strict=True):
            found = results.duels(TRAINED[SJE_ALGORITHM], theirs, RAMPS)
            ramps |= {kind: found[NOMINAL]} if NOMINAL in found else {}
    rises = {TRAINED[x]: results.rise(x, LATE) for x in ALGORITHMS}
    cell = results.cell("panda", RANDOM_PATHS)
    over = {} if cell is None else results.improvements(cell)
    write_page(
        folder / "policies.md",
        TEMPLATE,
        small=plan == SMALL,
        plan=plan,
        done=len(results.folders),
        in_all=trainings_in_all(plan),
        by_earlier_code=results.by_earlier_code,
        missing=results.missing,
        cells_in_all=len(results.in_all),
        learned=results.learned,
        duels=duels,
        duel_table=_duels(duels),
        turned=_turned(duels),
        moved=_moved(duels),
        ramps=ramps,
        rises={name: x for name, x in rises.items() if x is not None},
        most=_most(results, cell),
        bounded={}
        if cell is None
        else {key: results.against(cell, BOUND, NONE).less(key) for key in ERRORS},
        says=_says,
        frictions=[f for f in plan.frictions if f != NOMINAL],
        nominal=NOMINAL,
        aim=AIM,
        bound=BOUND,
        over=over,
        improvements=_improvements(over),
        baseline=BASELINES["panda"],
        baselines=BASELINES,
        trained=TRAINED,
        from_a_table=[TRAINED[algorithm] for algorithm in FROM_A_TABLE],
        searched=SEARCHED,
        sje=SJE_ALGORITHM,
        rule=agent_settings().rule,
        gate=agent_settings().gate,
        lever=load_gte_protocol().vibration_lever,
        sections=_sections(results),
        pictures=pictures | {BEHAVIOUR: behaviour is not None},
        behaviour=behaviour,
        names={"curves": CURVES, "pareto": PARETO, "behaviour": BEHAVIOUR},
        hours=results.training_hours,
        episodes=episodes_in_all(plan),
        measuring_hours=results.measuring_hours,
        rates=results.rates,
        together=TOGETHER,
        spreads=SPREADS,
        shaking_weight=SHAKING_WEIGHT,
        draws=DRAWS,
        level=LEVEL,
    )


WORDS = {
    "position": "position error",
    "orientation": "orientation error",
    "moving": "vibration moving",
    "at_rest": "at rest",
    "torque": "breakaway torque",
    "oscillation": "oscillation",
}


# ---- words ---------------------------------------------------------------------------------------


def _says(found: Against) -> str:
    """Return what one agent does against another: less or more, of everything."""

    def change(key: str) -> str:
        less = round(found.less(key))
        return f"{abs(less)} % {'less' if less > 0 else 'more'}" if less else "as much"

    wanted = " and ".join(f"{change(key)} {WORDS[key]}" for key in found.wanted)
    prices = " and ".join(f"{change(key)} {WORDS[key]}" for key in found.prices)
    doubt = [key for key in found.wanted if key not in (*found.better_in, *found.worse_in)]
    unsure = f" (not significant: {listed(doubt)})" if doubt else ""
    return f"{wanted} left{unsure}, {prices}"


def _turned(duels: dict[str, dict[float, Against]]) -> list[tuple[Against, float]]:
    """Return where another friction changes whether the learned policy beats someone."""
    return [
        (one, friction)
        for theirs in ("constant", "learned")
        for friction, one in duels.get(theirs, {}).items()
        if NOMINAL in duels[theirs] and one.beats != duels[theirs][NOMINAL].beats
    ]


def _moved(duels: dict[str, dict[float, Against]]) -> float:
    """Return by how much another friction moves what the learned policy does to others [points]."""
    return max(
        (
            abs(one.less(key) - duels[theirs][NOMINAL].less(key))
            for theirs in ("constant", "learned")
            for one in duels.get(theirs, {}).values()
            if NOMINAL in duels[theirs]
            for key in (*one.wanted, *one.prices)
        ),
        default=0.0,
    )


def _most(results: Results, cell: Cell | None) -> dict[str, float]:
    """Return the most that dither of any kind takes off what an undithered arm leaves [%]."""
    if cell is None:
        return {}
    others = (NONE, BOUND, *COMPENSATIONS)
    shaking = [name for name in results.by_cell[cell] if name not in others]
    return {
        key: max(results.against(cell, name, NONE).less(key) for name in shaking) for key in ERRORS
    }


def _range(found: Estimate, measure: Measure) -> str:
    if not math.isfinite(found.value):
        return "–"
    value, low, high = (number(x, measure.digits) for x in (found.value, found.low, found.high))
    return f"{value} ({low} to {high})"


# ---- tables --------------------------------------------------------------------------------------


def _duels(duels: dict[str, dict[float, Against]]) -> str:
    """Return a table: the learned policy against its rivals, and they each other, by friction."""
    lines = []
    for rivals in ("constant", "learned", "rule"):
        for friction, one in duels.get(rivals, {}).items():
            keys = (*one.wanted, *one.prices)
            changes = [signed(-one.less(key), 0) for key in keys]
            doubt = [key for key in one.wanted if key not in (*one.better_in, *one.worse_in)]
            verdict = "yes" if one.beats else "no"
            lines.append(
                [one.ours, one.theirs, f"× {friction:g}", *changes, listed(doubt) or "–", verdict]
            )
    header = ["agent", "against", "friction"]
    header += [f"{WORDS[key]} [%]" for key in (*ERRORS, *VIBRATIONS)]
    return "\n".join(table([*header, "not significant", "beats it"], lines)) if lines else ""


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
    return "\n".join(table([*header, "aim"], lines)) if lines else ""


def _sections(results: Results) -> dict[str, dict[str, str]]:
    """Return tables by title: everything at the nominal friction, then what friction changes."""
    out: dict[str, dict[str, str]] = {}
    cells = [c for c in results.by_cell if c.friction == NOMINAL]
    for cell in cells:
        of = f"{title(cell.robot)}, {cell.task}"
        out[of] = {"nominal": _nominal(results, cell), "others": _frictions(results, cell)}
    return out


def _nominal(results: Results, cell: Cell) -> str:
    measures = MEASURES[cell.experiment]
    lines = []
    for name, ones in results.by_cell[cell].items():
        runs = sum(len(results.rows.runs(one)) for one in ones)
        lost = results.truncated(cell, name)
        shown = name + (
            f", {runs} of {results.plan.runs} trained" if ones[0].run is not None else ""
        )
        shown += f", {lost} truncated" if lost else ""
        found = [_range(results.estimate(cell, name, key), m) for key, m in measures.items()]
        lines.append([shown, *found])
    header = [m.label + (f" [{m.unit}]" if m.unit != "1" else "") for m in measures.values()]
    return "\n".join(table(["agent", *header], lines))


def _frictions(results: Results, cell: Cell) -> str:
    """Return a table: errors and vibration at rest, or torque and oscillation, by friction."""
    keys = (*ERRORS, "at_rest") if cell.experiment == "gte" else ("torque", "oscillation")
    measures = MEASURES[cell.experiment]
    others = [results.cell(cell.robot, cell.task, f) for f in results.plan.frictions]
    there = [c for c in others if c is not None and c != cell]
    lines = []
    for name in results.by_cell[cell]:
        line = [name]
        for other in there:
            for key in keys:
                known = name in results.by_cell[other]
                found = results.estimate(other, name, key) if known else None
                line.append("–" if found is None else _range(found, measures[key]))
        lines.append(line)
    header = [f"× {c.friction:g}: {measures[key].label}" for c in there for key in keys]
    return "\n".join(table(["agent", *header], lines)) if there else ""
