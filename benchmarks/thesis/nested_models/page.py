"""The page of the nested models: `gap.md` and its pictures.

    write_page(folder, nested.models, study=study_phase())

Numbers are in per cent of the base torque unless a table says otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.thesis.nested_models import figures
from benchmarks.thesis.nested_models.cells import Cell, cells
from benchmarks.thesis.nested_models.fit import ROBOT
from benchmarks.thesis.nested_models.models import NestedModel
from benchmarks.thesis.nested_models.phase import PhaseStudy
from benchmarks.thesis.nested_models.scores import (
    FREQUENCIES,
    JOINTS,
    SAME_LOSS,
    SAME_RANGE,
    Change,
    ModelScores,
)
from benchmarks.thesis.nested_models.theory import poses_of
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.protocol import Configuration, configurations
from stiction_envs.measured import thesis_base
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.reporting.html import to_html
from stiction_envs.reporting.markdown import number, percent, short, signed, span, table

Array = NDArray[np.float64]
POSES = {"load": "load", "no_load": "no load"}
CLOSE = 2.0
"""Theory and simulation agree when they differ by less, in points of the base torque; assumed."""
GRAVITY = 5.0
"""Change of a joint's gravity torque between the poses from which it is compared with [N·m]."""
CAUSES = {
    "inertia": "rotor inertia",
    "presliding": "presliding and Stribeck effect",
    "path": "torque path: low-pass and rate limit",
    "elasticity": "spring between rotor and link",
    "load": "friction of its own in each pose",
    "offset": "offset: bias of gravity model or sensor, not friction",
    "drift": "the base moved between measuring days",
    "arm + drift": "the whole arm instead of a lone joint",
}
PARAMETERS = {
    "rotor_inertia": "rotor inertia [kg·m²]",
    "bristle_stiffness": "bristles σ0 [N·m/rad]",
    "coulomb_ratio": "F_c/F_s",
    "stribeck_velocity": "Stribeck v_s [rad/s]",
    "joint_stiffness": "joint spring K [N·m/rad]",
}
PICTURES = ("ladder.png", *(f"joint_{j}.png" for j in JOINTS), "iiwa.png")
MEASURE_NEXT = (
    "What would settle it: base torques repeated directly before each table (a base that moved "
    "cannot be predicted); the rate of the torque ramp, which trades off against inertia and "
    "bristles; the motor's angle beside the link's on joints 1 to 4, which shows the springs; "
    "three or more repeats of a few settings on different days."
)


def write_page(
    folder: Path,
    models: Mapping[str, NestedModel],
    *,
    study: PhaseStudy,
) -> dict[str, Any]:
    """Write `gap.md`, `report.html` and their pictures; return the errors [% of base torque].

    Args:
        folder: where; it exists.
        models: by key, as `NestedModels.models` when all are fitted.
        study: the iiwa's phases.

    Raises:
        StictionError: a model is missing, or predicts another number of cells.
    """
    chosen = cells()
    missing = [key for key in ModelScores.KEYS if key not in models]
    if missing:
        raise StictionError(f"the page needs all nested models: {', '.join(missing)} not fitted")
    for key, model in models.items():
        if len(model.change) != len(chosen):
            raise StictionError(
                f"model {key!r} predicts {len(model.change)} cells, but there are {len(chosen)}"
            )
    scores = ModelScores(models, chosen)
    for done, name in enumerate(PICTURES):
        if name == "ladder.png":
            figures.models(scores, folder / name)
        elif name == "iiwa.png":
            figures.iiwa(study, folder / name)
        else:
            figures.joint(scores, done, folder / name)
    lines = page(scores, study)
    write_text_atomic(folder / "gap.md", "\n".join(lines).rstrip("\n") + "\n")
    title = "The thesis's dithered torques, model by model"
    write_text_atomic(folder / "report.html", to_html(lines, folder, title))
    return {
        "repeats": {"mean": scores.floor[0], "median": scores.floor[1]},
        "models": [
            {
                "key": key,
                "name": x.name,
                "mean": x.mean,
                "ci95": [x.low, x.high],
                "median": x.median,
                "by_table": x.by_column,
                "by_joint": x.by_joint,
            }
            for key, x in scores.scores.items()
        ],
        "targets": {
            name: {"reached": reached, "target": aim, "met": reached <= aim}
            for name, (reached, aim) in scores.targets().items()
        },
    }


def page(s: ModelScores, study: PhaseStudy) -> list[str]:
    """Return the page's lines of Markdown."""
    of, last = s.scores, s.scores[s.last]
    parameters = [p for j in JOINTS for p in s.identified(j)[0]]
    gap, error = s.preferred("elasto-plastic", "drift")
    lines = [
        "# Where a simulated Panda's dither differs from the real one, and why",
        "",
        f"The last of these models, *{last.name}*, is off by {number(last.mean)} % of the base "
        f"torque [{number(last.low)}, {number(last.high)}] in the mean of {int(s.held_out.sum())} "
        f"held-out cells, {number(last.median)} % in the median; if dither did nothing it would be "
        f"{number(of['nothing'].mean)} %, and the thesis repeats itself to {number(s.floor[0])} "
        f"and {number(s.floor[1])} %.",
        "",
        f"A thesis (Lund 2023) measured {len(s.cells)} dithered breakaway torques on a Panda. Each "
        "model adds one physical statement to the one before, is fitted to Tables 4.3 and 4.6 "
        "alone, and predicts Tables 4.7, 4.8 and 4.10; priors and bounds have seen none of them "
        "(`dither_fit.toml`). Intervals are 95 % bootstraps over the 28 configurations.",
        "",
        "![held-out error of every model](ladder.png)",
        "",
        *_models(s),
        *_targets(s),
        "## The causes, joint by joint",
        "",
        "A statement is a cause where it lowers the joint's held-out error by more than the "
        "scatter of its cells: as predicted, or with each configuration's base free to move before "
        "and after. A *constant* is each configuration's median change in Table 4.6; where it is "
        "as good as the model, the tables do not show that physics is needed.",
        "",
        *_overview(s),
    ]
    for j in JOINTS:
        lines += [f"### Joint {j}", "", *_causes(s, j), f"![joint {j}](joint_{j}.png)", ""]
    return [
        *lines,
        "## What reaches the friction, and what frequency does",
        "",
        _theories(s),
        "",
        *_joints(s),
        "## Offset or asymmetric friction",
        "",
        "Base torques of two directions that differ may be friction of two levels or a bias, which "
        f"dither leaves alone: the held-out error is {number(of['load'].mean)} % with the one and "
        f"{number(of['offset'].mean)} % with the other.",
        "",
        *_asymmetry(s),
        "## The iiwa's trials at 100 Hz",
        "",
        _iiwa(study),
        "",
        "![iiwa](iiwa.png)",
        "",
        "## What was identified",
        "",
        f"{sum(p.verdict == 'yes' for p in parameters)} of {len(parameters)} parameters are "
        "identified. Best seed, in brackets the range over the seeds that fit equally well (loss "
        f"within {SAME_LOSS:g} of the best); † on its bound, ‡ range wider than a factor of "
        f"{SAME_RANGE:g}. The whole arm's values, corrected from these, are the Panda's shipped "
        "friction.",
        "",
        *_identification(s),
        "The thesis does not state the rate of its torque ramp:",
        "",
        *_ramp_rates(s),
        "An elasto-plastic joint (Dupont 2002), which does not creep, predicts the held-out cells "
        f"to {number(of['elasto-plastic'].mean)} %, LuGre to {number(of['drift'].mean)} %; the "
        f"fitted cells prefer it by {number(gap, 0)} in loss (two standard errors over the joints: "
        f"{number(error, 0)}).",
        "",
        "## What is left",
        "",
        MEASURE_NEXT,
        "",
        *_left(s),
    ]


def place(where: Configuration) -> str:
    """Return ``load +`` and the like, with a true minus."""
    return f"{POSES[where.load]} {'+' if where.direction == '+' else '−'}"


def _row(values: Iterable[float], digits: int = 1) -> str:
    return ", ".join(signed(x, digits) for x in values)


# ---- models and causes ---------------------------------------------------------------------------


def _models(s: ModelScores) -> list[str]:
    columns = list(s.scores[s.last].by_column)
    header = ["model", "mean [95 %]", "median", *columns, *(f"J{j}" for j in JOINTS), "statement"]
    rows = [
        [
            x.name,
            f"{number(x.mean)} [{number(x.low)}, {number(x.high)}]",
            number(x.median),
            *map(number, (*x.by_column.values(), *x.by_joint.values())),
            s.models[key].statement.rstrip("."),
        ]
        for key, x in s.scores.items()
    ]
    return table(header, rows)


def _targets(s: ModelScores) -> list[str]:
    rows = [
        [name, f"{number(x)} %", f"{aim:g} %", "met" if x <= aim else "**not met**"]
        for name, (x, aim) in s.targets().items()
    ]
    out = table(["held-out error", "reached", "target", ""], rows)
    for i, c in enumerate(s.cells):
        if c.row.outlier:
            text = f"Scored apart: {_cell(s, i)}; its own repeat in Table 4.10 refutes it."
            out += [text, ""]
    return out


def _cell(s: ModelScores, i: int) -> str:
    c: Cell = s.cells[i]
    return (
        f"Table {c.column}, joint {c.row.joint} {place(c.configuration)}, {c.row.frequency_hz:g} "
        f"Hz, {number(c.row.amplitude_nm, 2)} N·m: {percent(100 * c.change)} measured, "
        f"{percent(100 * s.predicted[s.last][i])} predicted"
    )


def _overview(s: ModelScores) -> list[str]:
    rows, of = [], s.scores
    for j in JOINTS:
        named = sorted((g for g in s.gains(j) if g.named), key=lambda g: -g.points)
        values = (of["nothing"].by_joint[j], s.constant(j), of[s.last].by_joint[j])
        causes = "; ".join(f"{CAUSES[g.key]} ({signed(g.points)})" for g in named) or "none"
        moved = {c: 100 * (x - 1) for c, x in s.drift().items() if c.joint == j}
        c = max(moved, key=lambda c: abs(moved[c]))
        base = f"{percent(moved[c])} ({place(c)})"
        rows.append([str(j), *(f"{number(x)} %" for x in values), causes, base])
    header = ["joint", "dither does nothing", "constant", "last model"]
    header += ["causes (points of error they take)", "base of Table 4.6 against 4.3, furthest"]
    return table(header, rows)


def _points(change: Change | None) -> str:
    if change is None:
        return ""
    return f"{signed(change.points)} [{signed(change.low)}, {signed(change.high)}]"


def _causes(s: ModelScores, joint: int) -> list[str]:
    rows = []
    for g in s.gains(joint):
        x = g.as_predicted
        rows.append(
            [
                f"**{CAUSES[g.key]}**" if g.named else CAUSES[g.key],
                f"{number(x.before)} → {number(x.after)} %",
                _points(x),
                _points(g.free_base),
                "a cause" if g.named else "worse" if g.worse else "–",
            ]
        )
    header = ["statement", "held-out error", "gain in points [95 %]", "with bases free to move"]
    return table([*header, ""], rows)


# ---- theory --------------------------------------------------------------------------------------


def _joints(s: ModelScores) -> list[str]:
    rows = []
    for j in JOINTS:
        theory, friction = s.theory(j), thesis_base(ROBOT).friction[j - 1]
        share = np.mean([theory.bristle_gain(FREQUENCIES, k) for k in range(2)], axis=0)
        swing = np.mean([theory.stroke(FREQUENCIES, friction[k], k) for k in range(2)], axis=0)
        shaken = np.ravel([theory.shaking(FREQUENCIES, friction[k], k) for k in range(2)])
        peaks = sorted({round(f) for k in range(2) for f, _ in theory.resonances(k)})
        stiffness = theory.parameter("joint_stiffness")
        rows.append(
            [
                str(j),
                *(_row(s.mean(s.at(j, f), k) for f in FREQUENCIES) for k in (None, s.last)),
                short(theory.rotor, 2),
                short(theory.parameter("bristle_stiffness"), 2),
                short(stiffness, 2) if theory.elastic else "rigid",
                ", ".join(map(str, peaks)) or "–",
                ", ".join(number(100 * x, 0) for x in share),
                ", ".join(number(1e3 * x, 2) for x in swing),
                span(shaken / theory.parameter("stribeck_velocity")),
                signed(100 * theory.step()),
            ]
        )
    header = ["joint", f"measured at {', '.join(f'{f:g}' for f in FREQUENCIES)} Hz [%]"]
    header += ["last model [%]", "rotor [kg·m²]", "bristles [N·m/rad]", "spring [N·m/rad]"]
    header += ["resonances [Hz]", "share of the dither at the friction [%]"]
    header += ["free swing at A = friction, peak to peak [mrad]", "shaken at so many v_s"]
    return table([*header, "step to kinetic friction [%]"], rows)


def _theory(s: ModelScores, key: str, kind: str, *, bias: bool) -> Array:
    """Return (cells,) what a theory predicts with the parameters of a model [% of base]."""
    theories = {j: s.theory(j, key) for j in JOINTS}
    changes = [
        theories[c.row.joint].change(
            kind, c.configuration, c.row.frequency_hz, c.row.amplitude_nm, bias=bias
        )
        for c in s.cells
    ]
    return 100 * np.array(changes, dtype=float)


def averaging(s: ModelScores) -> int:
    """Return how many cells of the model without bristles averaging theory bears out."""
    free, sliding = (_theory(s, "inertia", k, bias=False) for k in ("free", "sliding"))
    simulated = 100 * s.predicted["inertia"]
    low, high = np.minimum(free, sliding) - CLOSE, np.maximum(free, sliding) + CLOSE
    return int(((low <= simulated) & (simulated <= high)).sum())


def _theories(s: ModelScores) -> str:
    """Compare formulas with the simulation and with the robot."""
    theory = _theory(s, "offset", "creep", bias=True)
    joints = {j: s.theory(j, "offset") for j in JOINTS}
    sticks = [
        joints[c.row.joint].sticks(c.row.frequency_hz, c.row.amplitude_nm, c.configuration.index[1])
        for c in s.cells
    ]
    stuck = s.sound & np.array(sticks)
    held = s.held_out & stuck
    gap = float(np.median(np.abs(theory - 100 * s.predicted["offset"])[stuck]))
    error = float(np.abs(theory - 100 * s.measured)[held].mean())
    return (
        "Averaging theory, which knows neither bristles nor fits, has "
        f"{averaging(s)} of {len(s.cells)} cells of the model *{s.scores['inertia'].name}* between "
        f"its two limits, to {CLOSE:g} points. LuGre averaged over the shaking, a formula, comes "
        f"within {number(gap)} points (median) of *{s.scores['offset'].name}* in the {stuck.sum()} "
        f"of {s.sound.sum()} cells in which the joint sticks, and predicts their held-out ones to "
        f"{number(error)} %, the simulation to "
        f"{number(float(s.scores['offset'].error[held].mean()))} %."
    )


def _asymmetry(s: ModelScores) -> list[str]:
    base, gravity, rows = thesis_base(ROBOT), poses_of(ROBOT)[0], []
    for j in JOINTS:
        friction, offset = base.friction[j - 1], base.offset[j - 1]
        run = float(gravity[j - 1] @ (1, -1))
        known = abs(run) > GRAVITY and j > 1
        change = percent(100 * (offset[0] - offset[1]) / run) if known else "–"
        error = " → ".join(number(s.scores[k].by_joint[j]) for k in ("load", "offset"))
        levels = ", ".join(number(x, 2) for x in friction)
        rows.append([str(j), levels, _row(offset, 2), change, f"{error} %"])
    header = ["joint", "half-difference (friction), load, no load [N·m]"]
    header += ["half-sum (offset), load, no load [N·m]", "change of offset over gravity torque"]
    return table([*header, "held-out error, asymmetric → offset"], rows)


# ---- the iiwa, the fit, and what is left ---------------------------------------------------------


def _iiwa(study: PhaseStudy) -> str:
    measured, change, random = study.measured, study.change, study.over_random_phase

    def ends(x: Array) -> str:
        return f"{percent(100 * x.min())} to {percent(100 * x.max())}"

    return (
        f"At {study.controller_rate_hz:g} Hz, the usual rate, a sine of 100 Hz is sampled twice a "
        "period: ±A sin φ is sent, whose size depends on the phase alone. Over all phases the "
        f"simulated change is {ends(change)}, one setting differs by up to "
        f"{number(100 * np.ptp(change, axis=1).max(), 0)} points, and the mean over random phases "
        f"is {ends(random)}. Measured: {ends(measured)}; {study.within.sum()} of {len(measured)} "
        f"cells are what some phase gives, {(measured > 0).sum()} rose, which no phase does."
    )


def _identification(s: ModelScores) -> list[str]:
    rows = []
    for j in JOINTS:
        found, seeds = s.identified(j)
        texts = {}
        for p in found:
            ends = f" [{short(p.low)}, {short(p.high)}]" if p.seeds > 1 else ""
            mark = " †" if p.on_bound else " ‡" if p.verdict == "no" else ""
            texts[p.name] = short(p.best) + ends + mark
        good = max((p.seeds for p in found), default=0)
        rows.append([str(j), *(texts.get(n, "–") for n in PARAMETERS), f"{good} of {seeds}"])
    return table(["joint", *PARAMETERS.values(), "seeds as good"], rows)


def _ramp_rates(s: ModelScores) -> list[str]:
    rates = s.ramp_rates()
    loss = {r: float(s.models[k].loss or 0.0) for r, k in rates.items()}
    best = min(loss, key=loss.__getitem__)
    rows = []
    for r, k in rates.items():
        gap, error = s.preferred(rates[best], k)
        worse = "yes" if r != best and gap >= error else "no"
        over, mean = signed(loss[r] - loss[best]), f"{number(s.scores[k].mean, 2)} %"
        rows.append([f"{r:g}", number(loss[r]), over, worse, mean])
    header = ["ramp rate [N·m/s]", "loss of the fit", "over the best"]
    return table([*header, "clearly worse than the best", "held-out mean error"], rows)


def _left(s: ModelScores) -> list[str]:
    """Return of each joint's squared residual its share in all, its parts, and the worst."""
    residual, rows = s.residual(), []
    square = np.array([(residual[s.held_out & (s.joint == j)] ** 2).sum() for j in JOINTS])
    square /= square.sum() or 1.0
    parts = np.array([s.shares(j) for j in JOINTS])
    for j, share, mine in zip(JOINTS, square, parts, strict=True):
        held = s.held_out & (s.joint == j)
        means = {c: float(residual[held & s.of(c)].mean()) for c in configurations(7, [j])}
        worst = max(means, key=lambda c: abs(means[c]))
        cell = _cell(s, int(np.argmax(np.where(held, np.abs(residual), -1))))
        values = [f"{number(100 * x, 0)} %" for x in (share, *mine)]
        rows.append([str(j), *values, f"{place(worst)}, {signed(means[worst])} points", cell])
    rows.append(["all", "100 %", *(f"{number(100 * x, 0)} %" for x in square @ parts), "", ""])
    header = ["joint", "share of the squared residual", "constant per configuration"]
    header += ["common at one frequency", "neither", "worst configuration", "worst cell"]
    return table(header, rows)
