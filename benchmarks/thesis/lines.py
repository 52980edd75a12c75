"""Figure 2.3 (friction over speed), and the identification that failed.

Tables 4.1, 4.2, 4.4 and A.1, Figures 4.1 and A.1 are of simulated logs whose friction is known. The
column *simulated* is of the log with which all is wrong that `lsm.WRONG` names, *nothing wrong* of
the same arm with clean signals and the right model.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.thesis.items import Found, Needs, Picture, Table
from benchmarks.thesis.lsm import (
    ALL_WRONG,
    IIWA,
    PANDA,
    WRONG,
    FrictionCurve,
    LineFit,
    bands_of,
    friction,
)
from benchmarks.thesis.torques import base_jobs
from stiction_envs.experiments.sje.plots import plain_axes
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.measured.thesis_tables import thesis_table
from stiction_envs.reporting.markdown import number, short, signed, table_text
from stiction_envs.robots import arm_title, load_arm
from stiction_envs.robots.regressor import PARAMETERS, inertial_parameters

NOTHING = "nothing"
QUANTITIES = {
    "intercept": ("intercept_Nm", "intercept [N·m]"),
    "slope": ("slope_Nms_per_rad", "slope [N·m·s/rad]"),
    "r2": ("r2", "R²"),
}
"""Numbers of a line: column in print, and words on the page."""
FOUR = ("measured", "simulated", "difference", "nothing wrong")
THREE = ("measured", "simulated", "nothing wrong")
SHOWN_POINTS = 2000
"""Points of a panel."""
TRUTH, LINE = "0.1", "#c2590c"
LAW, PARTS, POINTS = "#1f5fa8", "0.35", "#c2410c"

WORDS = {ALL_WRONG: "with all defects", NOTHING: "nothing wrong"}
CURVE_NEEDS: Needs = {"curve": [PANDA]}
LINE_NEEDS: Needs = {"lsm": [(PANDA, wrong) for wrong in WRONG]}
LINK_NEEDS: Needs = {"lsm": [(IIWA, wrong) for wrong in (NOTHING, ALL_WRONG)]}
COMPARISON_NEEDS: Needs = {**LINE_NEEDS, "sje": [(PANDA, job) for job in base_jobs()]}


def _head(title: str, columns: tuple[str, ...] = THREE) -> list[str]:
    return [f"{title}: {columns[0]}", *columns[1:]]


# ---- lines ---------------------------------------------------------------------------------------


def _wrong_signs(intercepts: Mapping[tuple[int, str], float]) -> int:
    return sum((b > 0) != (direction == "+") for (_, direction), b in intercepts.items())


def _printed_intercepts() -> dict[tuple[int, str], float]:
    return {(r["joint"], r["direction"]): r["intercept_Nm"] for r in thesis_table("A.1")}


def compare_lines(found: Found) -> str:
    """Return how the lines of the log with all defects compare with the thesis's."""
    b = _printed_intercepts()
    wrong = {k: found["lsm"][PANDA, ALL_WRONG].lines[k].intercept for k in b}
    most = [short(max(map(abs, x.values())), 2) for x in (wrong, b)]
    return (
        f"{_wrong_signs(wrong)} of {len(b)} signs wrong (print {_wrong_signs(b)}), largest "
        f"{most[0]} N·m (print {most[1]})"
    )


def compare_joints(found: Found, joints: tuple[int, ...]) -> str:
    """Return how far the intercepts of some joints (from 1) are from those in print [N·m]."""
    printed, fit = _printed_intercepts(), found["lsm"][PANDA, NOTHING]
    gaps = [[abs(fit.lines[j, d].intercept - printed[j, d]) for d in "+-"] for j in joints]
    means = zip(joints, np.mean(gaps, axis=1), strict=True)
    text = ", ".join(f"{number(gap, 2)} N·m (joint {j})" for j, gap in means)
    return f"print is {text} from a clean log"


def _small(value: float) -> str:
    return "0" if abs(value) < 5e-7 else short(value)


def _line_name(printed: Mapping[str, Any]) -> str:
    return f"joint {printed['joint']} ({printed['direction'].replace('-', '−')})"


def _simulated(found: Found, printed: Mapping[str, Any], name: str) -> tuple[float, float]:
    """Return a number of a line, of the log with all defects and of that with none."""
    lines = (found["lsm"][PANDA, w].lines[printed["joint"], printed["direction"]] for w in WORDS)
    now, best = (float(getattr(line, name)) for line in lines)
    return now, best


def table_4_2(found: Found) -> Table:
    """Return Table 4.2: one printed number of a line per row."""
    lines, shown, printed = [], [], thesis_table("4.2")
    for r in printed:
        name, value = r["quantity"].lower(), r["value"]
        now, best = _simulated(found, r, name)
        added = {"simulated": now, "difference": now - value, "simulated_nothing_wrong": best}
        lines.append({**r, **added})
        values = map(_small, (value, *added.values()))
        shown.append([_line_name(r), QUANTITIES[name][1], *values])
    return Table(
        rows=lines,
        header=["line", "", *FOUR],
        shown=shown,
        compared=compare_joints(found, tuple(sorted({r["joint"] for r in printed}))),
    )


def table_a_1(found: Found) -> Table:
    """Return Table A.1, a line per row, and what one defect at a time does to lines."""
    lines, shown = [], []
    for r in thesis_table("A.1"):
        values = {c: (r[c], *_simulated(found, r, x)) for x, (c, _) in QUANTITIES.items()}
        lines.append(
            {
                **r,
                **{f"simulated_{c}": now for c, (_, now, _) in values.items()},
                **{f"difference_{c}": now - old for c, (old, now, _) in values.items()},
                **{f"simulated_nothing_wrong_{c}": best for c, (_, _, best) in values.items()},
            }
        )
        (old, now, best), slope, r2 = values.values()
        numbers = [signed(x, 3) for x in (old, now, now - old, best, *slope)]
        shown.append([_line_name(r), *numbers, *map(_small, r2)])
    words = [x for _, x in QUANTITIES.values()]
    return Table(
        rows=lines,
        header=["line", *_head(words[0], FOUR), *_head(words[1]), *_head(words[2])],
        shown=shown,
        compared=compare_lines(found),
        below=f"\n\n{_defects(found)}",
    )


def _defects(found: Found) -> str:
    """Return a table of what one defect at a time does to the lines."""
    bands, rows = bands_of(PANDA), []
    for wrong in WRONG:
        fit: LineFit = found["lsm"][PANDA, wrong]
        plus, minus = np.array([[fit.lines[j, d].intercept for j in range(1, 8)] for d in "+-"])
        off = 100 * np.abs((plus - minus) / 2 / bands - 1)
        signs = _wrong_signs({k: x.intercept for k, x in fit.lines.items()})
        middle = float(np.abs(plus + minus).max() / 2)
        r2 = [x.r2 for x in fit.lines.values()]
        values = [f"{np.median(off):.0f} % ({off.max():.0f} %)", f"{middle:.2f}", str(signs)]
        rows.append([wrong, *values, f"{np.median(r2):.2g} ({min(r2):.1g})"])
    header = ["wrong with the log", "band off by, median (worst)", "bands' middle, worst [N·m]"]
    return table_text([*header, "wrong signs", "R², median (least)"], rows)


def table_4_4(found: Found) -> Table:
    """Return Table 4.4: intercepts of lines beside base torques."""
    lines, shown, gaps = [], [], []
    for r in thesis_table("4.4"):
        wrong, clean = _simulated(found, r, "intercept")
        base = found["sje"][PANDA, Job(Configuration(r["joint"], r["load"], r["direction"]))].mean
        printed, torque = r["lsm_intercept_Nm"], r["tau_base_Nm"]
        lines.append(
            {
                **r,
                "simulated_intercept_Nm": wrong,
                "difference_intercept_Nm": wrong - printed,
                "simulated_nothing_wrong_intercept_Nm": clean,
                "simulated_tau_base_Nm": base,
            }
        )
        gaps.append((abs(printed - torque), abs(wrong - base), abs(clean - base)))
        pose = r["load"].replace("_", " ")
        values = (printed, wrong, wrong - printed, clean, torque, base, base - torque)
        shown.append([f"{_line_name(r)} {pose}", *(signed(x, 3) for x in values)])
    old, now, best = (number(float(x), 2) for x in np.nanmedian(gaps, axis=0))
    brief = f"{now} N·m apart (print {old}, nothing wrong {best})"
    base_head = _head("base torque [N·m]", FOUR[:3])
    return Table(
        rows=lines,
        header=["joint, pose", *_head("intercept [N·m]", FOUR), *base_head],
        shown=shown,
        compared=brief,
    )


# ---- links ---------------------------------------------------------------------------------------


def _link_values(fit: LineFit) -> dict[tuple[int, str], float]:
    """Return what Table 4.1 has of every link, by its name there."""
    assert fit.links is not None
    theirs = {f"i_{x}": f"I{x}" for x in ("xx", "yy", "zz", "xy", "yz")} | {"i_zx": "Ixz"}
    out: dict[tuple[int, str], float] = {}
    for j, phi in enumerate(fit.links.phi, 1):
        of = dict(zip(PARAMETERS, map(float, phi), strict=True))
        out[j, "mass"] = of["m"]
        out |= {(j, f"com_{axis}"): of[f"m{axis}"] / of["m"] for axis in "xyz"}
        out |= {(j, printed): of[ours] for printed, ours in theirs.items()}
        out[j, "coulomb"] = float(fit.links.coulomb[j - 1])
        out[j, "viscous"] = float(fit.links.viscous[j - 1])
    return out


def table_4_1(found: Found) -> Table:
    """Return Table 4.1: links by RosDyn's least squares."""
    fits = {w: found["lsm"][IIWA, w] for w in (NOTHING, ALL_WRONG)}
    wrong, clean = (_link_values(fits[w]) for w in (ALL_WRONG, NOTHING))
    rows = thesis_table("4.1")
    true = inertial_parameters(load_arm(IIWA).pinocchio())[:, 0]
    printed = {(r["joint"], r["quantity"]): r["value"] for r in rows}
    joints = dict.fromkeys(j for j, _ in printed)
    shown = [
        [
            f"link {j}",
            short(printed[j, "mass"]),
            short(wrong[j, "mass"]),
            signed(wrong[j, "mass"] - printed[j, "mass"], 1),
            short(clean[j, "mass"]),
            short(float(true[j - 1])),
            *(short(x[j, n]) for n in ("coulomb", "viscous") for x in (printed, wrong, clean)),
        ]
        for j in joints
    ]
    links = fits[ALL_WRONG].links
    now, old = (number(sum(x[j, "mass"] for j in joints), 0) for x in (wrong, printed))
    brief = f"{len(links.impossible)} of {len(joints)} links cannot exist; {now} kg (print {old})"
    mass, rubbing = _head("mass [kg]", FOUR), (_head("Coulomb [N·m]"), _head("viscous [N·m·s/rad]"))
    return Table(
        rows=[
            {
                **r,
                "simulated": wrong[k],
                "difference": wrong[k] - r["value"],
                "simulated_nothing_wrong": clean[k],
            }
            for r in rows
            if (k := (r["joint"], r["quantity"]))
        ],
        header=["", *mass, "true", *rubbing[0], *rubbing[1]],
        shown=shown,
        compared=brief,
    )


# ---- figures -------------------------------------------------------------------------------------


def _panel(axes: Axes, fit: LineFit, joint: int, title: str) -> None:
    """Draw friction torque over speed of one joint (from 1), and its two lines."""
    speed, torque = fit.speed[:, joint - 1], fit.torque[:, joint - 1]
    step = max(1, len(speed) // SHOWN_POINTS)
    axes.plot(speed[::step], torque[::step], ".", ms=2.2, color="0.6", mew=0)
    for direction, sign in (("+", 1), ("-", -1)):
        mine = fit.lines[joint, direction]
        x = np.array([0.0, sign * np.percentile(np.abs(speed), 99.5)])
        text = f"({direction.replace('-', '−')}) {signed(mine.intercept, 2)} N·m, R² {mine.r2:.2g}"
        axes.plot(x, mine.slope * x + mine.intercept, color=LINE, lw=2, label=text)
    x = np.linspace(np.percentile(speed, 0.2), np.percentile(speed, 99.8), 600)
    truth = friction(x[:, None], bands_of(fit.robot)[joint - 1 : joint])[:, 0]
    axes.plot(x, truth, color=TRUTH, lw=1.2, ls=(0, (4, 2)), label="true friction")
    limit = 1.55 * max(float(np.percentile(np.abs(torque), 99)), float(np.abs(truth).max()))
    axes.set_ylim(-limit, limit)
    axes.set_title(title, fontsize=10, loc="left")
    axes.set_xlabel("joint speed [rad/s]", fontsize=9)
    axes.set_ylabel("friction torque [N·m]", fontsize=9)
    plain_axes(axes)
    axes.legend(fontsize=8, frameon=False, loc="upper left")


def figure_4_1(found: Found) -> Picture:
    """Return Figure 4.1: joints 7 and 1, with nothing wrong below."""
    figure = Figure(figsize=(11, 7.6), layout="constrained")
    for row, wrong in zip(figure.subplots(2, 2), WORDS, strict=True):
        for axes, joint, letter in zip(row, (7, 1), "ab", strict=True):
            title = f"({letter}) joint {joint}, {WORDS[wrong]}"
            _panel(axes, found["lsm"][PANDA, wrong], joint, title)
    return Picture(figure, compare_joints(found, (1, 7)))


def figure_a_1(found: Found) -> Picture:
    """Return Figure A.1: all joints."""
    figure = Figure(figsize=(11, 14.5), layout="constrained")
    *grid, empty = figure.subplots(4, 2).ravel()
    for joint, axes in enumerate(grid, 1):
        title = f"({'abcdefg'[joint - 1]}) joint {joint}"
        _panel(axes, found["lsm"][PANDA, ALL_WRONG], joint, title)
    empty.set_visible(False)
    return Picture(figure, compare_lines(found))


def figure_2_3(found: Found) -> Picture:
    """Return Figure 2.3: the low-speed zone at the left, a hundred times as much at the right."""
    curve: FrictionCurve = found["curve"][PANDA]
    figure = Figure(figsize=(11, 5.2), layout="constrained")
    zone, fastest = 3 * float(curve.stribeck.max()), float(np.abs(curve.speed).max())
    for axes, ends in zip(figure.subplots(1, 2, sharey=True), (1.6 * zone, fastest), strict=True):
        _draw_curve(axes, curve, ends, zone)
    figure.axes[0].set_ylabel("friction torque [N·m]")
    handles, names = figure.axes[0].get_legend_handles_labels()
    once = dict(zip(names, handles, strict=True))
    figure.legend(
        once.values(), once, loc="outside lower center", ncols=6, frameon=False, fontsize=9
    )
    figure.suptitle(f"{arm_title(curve.robot)}, joint 1", fontsize=11)
    return Picture(figure, compare_curve(curve))


def _draw_curve(axes: Axes, curve: FrictionCurve, ends: float, zone: float) -> None:
    axes.axvspan(-zone, zone, color="0.9", zorder=0, label="low speeds: Stribeck effect")
    for k, sign in enumerate((1.0, -1.0)):
        v = sign * np.linspace(0, ends, 400)[1:]
        level = np.full_like(v, sign * curve.coulomb[k])
        axes.plot(v, curve.law(v), color=LAW, lw=2, label="law of the model")
        axes.plot(v, level, color=PARTS, lw=1, ls=(0, (5, 3)), label="Coulomb friction")
        viscous = curve.viscous[k] * v
        axes.plot(v, viscous, color=PARTS, lw=1, ls=(0, (1, 2)), label="viscous friction")
        stiction = sign * curve.stiction[k]
        axes.plot([0, 0], [0, stiction], "o-", color=LAW, lw=2, ms=5, label="stiction")
    shown = np.abs(curve.speed) <= ends
    style: dict[str, Any] = {"ms": 4.5, "mfc": "white", "color": POINTS, "zorder": 5}
    x, y = curve.speed[shown], curve.torque[shown]
    axes.plot(x, y, "o", label="simulated at constant speed", **style)
    axes.axhline(0, color="0.6", lw=0.8)
    axes.set_xlim(-ends, ends)
    axes.set_xlabel("joint speed [rad/s]")
    plain_axes(axes)


def compare_curve(curve: FrictionCurve) -> str:
    """Return how far the simulation is from the law of the model."""
    off = 100 * np.abs(curve.torque / curve.law(curve.speed) - 1)
    return f"{number(float(off.max()))} % off its law"
