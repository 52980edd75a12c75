"""The page's account of its own limits: what was identified, what is left, what to measure."""

from __future__ import annotations

from stiction_envs.experiments.sje.protocol import configurations
from stiction_envs.reporting.markdown import joints, listed, percent, short, signed, span, table
from stiction_envs.thesis.scores import JOINTS, SAME_LOSS, SAME_RANGE, Findings
from stiction_envs.thesis.words import UNITS, place

BASE_SHARE, TONE_SHARE = 0.3, 0.15
"""Shares of the squared residual from which a remedy is proposed; assumed."""
NO_DIFFERENCE = 0.3
"""Mean errors that differ by less, in points, are the same; assumed."""
SYMBOLS = {
    "rotor_inertia": "rotor inertia",
    "bristle_stiffness": "bristles σ0",
    "coulomb_ratio": "F_c/F_s",
    "stribeck_velocity": "Stribeck v_s",
    "joint_stiffness": "joint spring K",
}


def identification(f: Findings) -> list[str]:
    """Return what the search found, how sure it is, and what it could not tell."""
    lines = ["## What was identified, and what cannot be", ""]
    found = {j: {p.name: p for p in f.identified(j)} for j in JOINTS}
    names = [n for n in SYMBOLS if any(n in found[j] for j in JOINTS)]
    if not names:
        return [*lines, "Nothing has been fitted in this run.", ""]
    rows = []
    for j in JOINTS:
        row = [str(j)]
        for name in names:
            p = found[j].get(name)
            if p is None:
                row.append("rigid" if name == "joint_stiffness" else "–")
                continue
            mark = " †" if p.on_bound else " ‡" if p.verdict == "no" else ""
            reach = f" [{short(p.low)}, {short(p.high)}]" if p.seeds > 1 else ""
            row.append(f"{short(p.best)}{reach}{mark}")
        good = max((p.seeds for p in found[j].values()), default=0)
        rows.append([*row, f"{good} of {f.seeds(j)}"])
    header = ["joint"]
    for name in names:
        unit = UNITS[name]
        header.append(SYMBOLS[name] + ("" if "/" in SYMBOLS[name] else f" [{unit}]"))
    lines += [
        "From the last rung that was searched from several places; the whole arm's values, "
        "corrected from there, are the Panda's shipped friction (`friction/panda.toml`). "
        "Best seed, and in brackets the range over the seeds that fit equally well (loss within "
        f"{SAME_LOSS:g} of the best). † on its bound. ‡ not identifiable: the range is wider than "
        f"a factor of {SAME_RANGE:g}.",
        "",
        *table([*header, "seeds as good"], rows),
    ]
    lines += _verdicts(f)
    return [*lines, *_ramp(f), *_plastic(f)]


def _verdicts(f: Findings) -> list[str]:
    by: dict[str, list[str]] = {"yes": [], "no": [], "cannot tell": []}
    for j in JOINTS:
        for p in f.identified(j):
            by[p.verdict].append(f"{SYMBOLS.get(p.name, p.name)} of joint {j}")
    total = sum(map(len, by.values()))
    lines = []
    if by["cannot tell"]:
        lines.append(
            f"{len(by['cannot tell'])} of {total} parameters were sought from one starting point "
            "only (or only one found the best place): whether they are identified cannot be told."
        )
    if by["yes"]:
        lines.append(f"Identified: {len(by['yes'])} of {total} parameters.")
    if by["no"]:
        lines.append(
            f"Not identifiable from Tables 4.3 and 4.6: {listed(by['no'])}. There inertia, bristle "
            "stiffness, Stribeck velocity and ramp rate trade off against each other "
            "(physics.md 5.1)."
        )
    return [" ".join(lines), ""] if lines else []


def _ramp(f: Findings) -> list[str]:
    rates = {r: k for r, k in f.ramp_rates().items() if f.rungs[k].loss is not None}
    if not rates:
        return []
    loss = {r: float(f.rungs[k].loss or 0.0) for r, k in rates.items()}
    mean = {r: f.scores[k].mean for r, k in rates.items()}
    best = min(loss, key=loss.__getitem__)
    rows = [
        [f"{r:g}", f"{loss[r]:.1f}", signed(loss[r] - loss[best]), f"{mean[r]:.2f} %"]
        for r in rates
    ]
    header = ["ramp rate [N·m/s]", "loss of the fit", "over the best", "held-out mean error"]
    same = [best]
    for rate, key in rates.items():
        if rate != best:
            gap, error = f.preferred(rates[best], key)
            same += [rate] if gap < error else []
    text = f"The thesis does not state the rate of its torque ramp. Fitted best at {best:g} N·m/s"
    if best in (min(rates), max(rates)) and len(rates) > 1:
        text += ", an end of what was tried"
    if len(same) > 1:
        text += (
            f"; {listed(f'{r:g}' for r in sorted(same))} N·m/s fit equally well within twice the "
            "standard error over the joints"
        )
    reach = max(mean.values()) - min(mean.values())
    text += f". The held-out error differs by {reach:.2f} points over all rates: " + (
        "the other parameters take its place, and dithered torques do not tell it."
        if reach < NO_DIFFERENCE
        else "it matters."
    )
    return [text, "", *table(header, rows)]


def _plastic(f: Findings) -> list[str]:
    key, other = "elasto-plastic", "drift"
    if not {key, other} <= set(f.rungs):
        return []
    a, b = f.scores[key].mean, f.scores[other].mean
    text = (
        "LuGre creeps under a load that swings inside the band; an elasto-plastic joint (Dupont "
        f"2002) does not. Fitted in its place it predicts the held-out cells to {a:.1f} % "
        f"(LuGre {b:.1f} %)."
    )
    grown = {j: f.scores[key].by_joint[j] - f.scores[other].by_joint[j] for j in JOINTS}
    if abs(a - b) < NO_DIFFERENCE:
        text += " They do not tell the two apart: the result does not rest on LuGre's creep."
    elif a > b:
        worst = [j for j in JOINTS if grown[j] >= 1]
        text += " They speak for creep inside the band"
        text += f", most on {joints(worst)}." if worst else "."
    else:
        text += " They speak *against* LuGre's creep inside the band."
    gap, error = f.preferred(key, other)
    if abs(gap) > error:
        which = "elasto-plastic joint" if gap > 0 else "LuGre"
        text += (
            f" The fitted cells prefer the {which}, by {abs(gap):.0f} in loss "
            f"(twice the standard error over the joints: {error:.0f})."
        )
    return [text, ""]


def remains(f: Findings) -> list[str]:
    """Return what is left and which measurement would settle it."""
    lines = ["## What is left, and which measurement would settle it", ""]
    rows = [
        [name, f"{reached:.1f} %", f"{aim:g} %", "met" if reached <= aim else "**not met**"]
        for name, (reached, aim) in f.targets().items()
    ]
    lines += table(["held-out error", "reached", "target", ""], rows)
    floor = f.floor
    lines += [
        f"The thesis's own repeats of one setting differ by {floor[0]:.1f} % mean and "
        f"{floor[1]:.1f} % median: less cannot be asked of a prediction.",
        "",
        "![residuals](residuals.png)",
        "",
    ]
    shares = {j: f.shares(j) for j in JOINTS}
    squares = {j: float((f.residual()[f.held_out & (f.joint == j)] ** 2).sum()) for j in JOINTS}
    total = sum(squares.values())
    if not total:
        return [*lines, "Nothing is left.", ""]
    parts = [sum(squares[j] * shares[j][k] for j in JOINTS) / total for k in range(3)]
    ordered = sorted(JOINTS, key=lambda j: -squares[j])
    most = [j for j in ordered if squares[j] > total / len(JOINTS)]
    of_most = 100 * sum(squares[j] for j in most) / total
    lines += [
        f"{joints(sorted(most)).capitalize()} hold {of_most:.0f} % of the squared residual. Of all "
        f"of it, {100 * parts[0]:.0f} % is constant per configuration, {100 * parts[1]:.0f} % "
        f"common to a joint's configurations at one frequency, {100 * parts[2]:.0f} % neither.",
        "",
    ]
    return [*lines, *_measurements(f, parts, shares), *_broken(f)]


def _measurements(
    f: Findings, parts: list[float], shares: dict[int, tuple[float, float, float]]
) -> list[str]:
    lines = []
    if parts[0] >= BASE_SHARE:
        residual = f.residual()
        means = {
            c: float(residual[f.held_out & f.of(c)].mean())
            for c in configurations(7)
            if (f.held_out & f.of(c)).any()
        }
        worst = sorted(means, key=lambda c: -abs(means[c]))[:3]
        names = [f"joint {c.joint} {place(c)} ({signed(means[c])})" for c in worst]
        lines.append(
            "**Base torques repeated directly before each table.** Where the residuals of a "
            "configuration all lie on one side, its base has moved since Table 4.6, which no model "
            f"can know, or its level is wrong: {listed(names)} points. One base ramp per "
            "configuration and table would tell."
        )
    toned = [j for j in JOINTS if shares[j][1] >= TONE_SHARE and f.scores[f.last].by_joint[j] > 2]
    if toned:
        peaks = [x for j in toned for k in range(2) for x, _ in f.theory(j).resonances(k)]
        at = f" at {span(peaks)} Hz" if peaks else ""
        lines.append(
            f"**Finer frequencies on {joints(toned)}.** Part of what is left there belongs to a "
            f"frequency, and the model has its resonances{at}, between the four frequencies tried: "
            "steps of 5 Hz at one amplitude would show them or their absence."
        )
    if f.ramp_rates():
        lines.append(
            "**The ramp: its rate, its steps, and whether the dither runs before it starts.** One "
            "number would free inertia and bristles from trading off against it; the same joint "
            "ramped twice as fast would do as well."
        )
    elastic = [j for j in JOINTS if f.theory(j).elastic]
    if elastic:
        lines.append(
            f"**The motor-side angle (`theta`) recorded with the link's on {joints(elastic)}.** It "
            "shows a joint's spring and its rotor's motion under dither directly, instead of "
            "through a breakaway torque."
        )
    lines.append(
        "**Three or more repeats of a few settings on different days.** The intervals here come "
        "from cells that were measured once; a cell's own scatter is known only through "
        f"{int((f.table == '4.10 intermediate').sum())} repeats."
    )
    return [*(f"- {line}" for line in lines), ""]


def _broken(f: Findings) -> list[str]:
    out = []
    for i, c in enumerate(f.cells):
        if c.row.outlier:
            out.append(
                f"Apart stands Table {c.row.table}, joint {c.row.joint}, {place(c.configuration)}, "
                f"{c.row.frequency_hz:g} Hz, scale {c.row.scale:g}: printed "
                f"{percent(100 * c.change)}, predicted {percent(100 * f.predicted[f.last][i])}; "
                "its own repeat in Table 4.10 refutes it."
            )
    return [*out, ""] if out else []
