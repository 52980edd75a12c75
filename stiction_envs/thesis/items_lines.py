"""Tables 4.1, 4.2, 4.4 and A.1, Figures 4.1 and A.1: the identification that failed.

The simulated logs have known friction. The column *simulated* is of the log with which all is wrong
that `lsm.WRONG` names, *nothing wrong* of the same arm with clean signals and the right model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stiction_envs.experiments.sje.protocol import Configuration, Job, configurations
from stiction_envs.measured import thesis_robots, thesis_table
from stiction_envs.reporting.markdown import short, signed
from stiction_envs.robots import load_arm
from stiction_envs.robots.regressor import PARAMETERS, inertial_parameters
from stiction_envs.thesis.items import (
    Found,
    Item,
    Needs,
    Said,
    Written,
    say,
    write_figure,
    write_table,
)
from stiction_envs.thesis.lsm import ALL_WRONG, LINES, LINKS, WRONG, LineFit, bands_of, friction

(PANDA,), (IIWA,) = LINES, LINKS
NOTHING = "nothing"
SINGLE_DEFECTS = {
    "noisy acceleration": "a noisy acceleration",
    "gravity error": "an error of gravity",
    "no slow data": "the lack of slow data",
    "filtered speeds that lag": "a lag of filtered speeds",
}
"""Of `lsm.WRONG`, as a sentence has them."""
QUANTITIES = {"intercept": "intercept", "slope": "slope", "r2": "r2"}
"""Field of a line by its name in Table 4.2."""
WORDS = {"intercept": "intercept [N·m]", "slope": "slope [N·m·s/rad]", "r2": "R²"}
SHOWN_POINTS = 2000
"""Points of a panel."""
TRUTH, LINE = "0.1", "#c2590c"


def line_needs() -> Needs:
    """Return what tables and figures of lines need: one thing wrong at a time."""
    return {"lsm": [(PANDA, wrong) for wrong in WRONG]}


def comparison_needs() -> Needs:
    """Return what Table 4.4 needs: lines, and base torques."""
    return {**line_needs(), "sje": [(PANDA, Job(c)) for c in configurations(7)]}


def link_needs() -> Needs:
    """Return what Table 4.1 needs."""
    return {"lsm": [(IIWA, NOTHING), (IIWA, ALL_WRONG)]}


def _intercepts(fit: LineFit) -> dict[tuple[int, str], float]:
    return {(x.joint, x.direction): x.intercept for x in fit.lines}


def _wrong_signs(values: Mapping[tuple[int, str], float]) -> int:
    return sum((v > 0) != (direction == "+") for (_, direction), v in values.items())


def say_lines(fits: Mapping[str, LineFit]) -> Said:
    """Return what the lines of the simulated logs, by what is wrong, say of the thesis's."""
    rows = thesis_table("A.1")
    keys = [(r["joint"], r["direction"]) for r in rows]
    bands = bands_of(PANDA)
    printed = {k: r["intercept_Nm"] for k, r in zip(keys, rows, strict=True)}
    of = {w: {k: _intercepts(f)[k] for k in keys} for w, f in fits.items()}
    clean, wrong = of[NOTHING], of[ALL_WRONG]
    off = {
        w: max(abs(abs(x) - bands[j - 1]) for (j, _), x in of[w].items()) for w in SINGLE_DEFECTS
    }
    a, b = np.array(list(printed.values())), np.array(list(wrong.values()))
    return say(
        "lines",
        lines=len(keys),
        printed_wrong=_wrong_signs(printed),
        simulated_wrong=_wrong_signs(wrong),
        clean_wrong=_wrong_signs(clean),
        share=[abs(x) / bands[j - 1] for (j, _), x in clean.items()],
        most_printed=float(np.abs(a).max()),
        most_simulated=float(np.abs(b).max()),
        r2_printed=float(np.median([r["r2"] for r in rows])),
        r2_clean=[x.r2 for x in fits[NOTHING].lines],
        r2_noise=float(np.median([x.r2 for x in fits["noisy acceleration"].lines])),
        same_sign=int((np.sign(a) == np.sign(b)).sum()),
        cause=SINGLE_DEFECTS[max(off, key=off.__getitem__)],
    )


def say_two(fits: Mapping[str, LineFit], joints: Sequence[int]) -> Said:
    """Return for some joints (from 1) which simulated log theirs is like."""
    printed = {(r["joint"], r["direction"]): r for r in thesis_table("A.1")}
    bands = bands_of(PANDA)

    def off(joint: int, wrong: str) -> float:
        gaps = [
            abs(fits[wrong].of(joint, d).intercept - printed[joint, d]["intercept_Nm"])
            for d in "+-"
        ]
        return float(np.mean(gaps))

    return say(
        "two",
        joints=[
            {
                "joint": j,
                "clean": off(j, NOTHING),
                "wrong": off(j, ALL_WRONG),
                "band": float(bands[j - 1]),
            }
            for j in joints
        ],
        r2_clean=[x.r2 for x in fits[NOTHING].lines if x.joint in joints],
        r2_printed=[r["r2"] for (j, _), r in printed.items() if j in joints],
    )


# ---- lines ---------------------------------------------------------------------------------------


def _fits(found: Found) -> dict[str, LineFit]:
    return {wrong: found["lsm"][PANDA, wrong] for wrong in WRONG}


def _line_table(
    item: Item,
    folder: Path,
    fits: Mapping[str, LineFit],
    cells: Sequence[tuple[Mapping[str, Any], float, str]],
    said: Said,
) -> Written:
    """Write a table with one printed number of a line per row.

    Args:
        item: the table.
        folder: where.
        fits: by what is wrong.
        cells: printed row, its number, the line's field.
        said: of the table.
    """
    wrong, clean = fits[ALL_WRONG], fits[NOTHING]
    lines, shown = [], []
    for printed, value, name in cells:
        key = printed["joint"], printed["direction"]
        now, best = (float(getattr(f.of(*key), name)) for f in (wrong, clean))
        lines.append([*printed.values(), now, now - value, best])
        sign = printed["direction"].replace("-", "−")
        shown.append(
            [f"joint {key[0]} ({sign})", WORDS[name], *map(_small, (value, now, now - value, best))]
        )
    return write_table(
        item,
        folder,
        columns=[*cells[0][0], "simulated", "difference", "simulated_nothing_wrong"],
        rows=lines,
        header=["line", "", "measured", "simulated", "difference", "nothing wrong"],
        shown=shown,
        said=said,
    )


def _small(value: float) -> str:
    return "0" if abs(value) < 5e-7 else short(value)


def write_two_joints(item: Item, found: Found, folder: Path) -> Written:
    """Write Table 4.2."""
    fits, rows = _fits(found), thesis_table("4.2")
    cells = [(r, r["value"], QUANTITIES[r["quantity"].lower()]) for r in rows]
    joints = sorted({r["joint"] for r in rows})
    return _line_table(item, folder, fits, cells, say_two(fits, joints))


def write_all_joints(item: Item, found: Found, folder: Path) -> Written:
    """Write Table A.1: a row of the CSV has all three numbers of a line."""
    fits = _fits(found)
    wrong, clean = fits[ALL_WRONG], fits[NOTHING]
    lines, shown = [], []
    for r in thesis_table("A.1"):
        mine, best = wrong.of(r["joint"], r["direction"]), clean.of(r["joint"], r["direction"])
        values = (mine.intercept, mine.slope, mine.r2)
        lines.append(
            [
                *r.values(),
                *values,
                mine.intercept - r["intercept_Nm"],
                mine.slope - r["slope_Nms_per_rad"],
                mine.r2 - r["r2"],
                best.intercept,
                best.slope,
                best.r2,
            ]
        )
        shown.append(
            [
                f"joint {r['joint']} ({r['direction'].replace('-', '−')})",
                signed(r["intercept_Nm"], 3),
                signed(mine.intercept, 3),
                signed(mine.intercept - r["intercept_Nm"], 3),
                signed(best.intercept, 3),
                *(signed(x, 3) for x in (r["slope_Nms_per_rad"], mine.slope, best.slope)),
                *(_small(x) for x in (r["r2"], mine.r2, best.r2)),
            ]
        )
    names = ("intercept_Nm", "slope_Nms_per_rad", "r2")
    three = ["measured", "simulated", "nothing wrong"]
    return write_table(
        item,
        folder,
        columns=[
            *thesis_table("A.1")[0],
            *(f"simulated_{n}" for n in names),
            *(f"difference_{n}" for n in names),
            *(f"simulated_nothing_wrong_{n}" for n in names),
        ],
        rows=lines,
        header=[
            "line",
            *("intercept [N·m]: measured", "simulated", "difference", "nothing wrong"),
            *(f"slope [N·m·s/rad]: {three[0]}", *three[1:]),
            *(f"R²: {three[0]}", *three[1:]),
        ],
        shown=shown,
        said=say_lines(fits),
    )


def write_comparison(item: Item, found: Found, folder: Path) -> Written:
    """Write Table 4.4: intercepts of lines beside base torques."""
    fits = _fits(found)
    wrong, clean = (_intercepts(fits[w]) for w in (ALL_WRONG, NOTHING))
    lines, shown = [], []
    gaps: dict[str, list[float]] = {"printed": [], "simulated": [], "clean": []}
    for r in thesis_table("4.4"):
        key = r["joint"], r["direction"]
        base = found["sje"][PANDA, Job(Configuration(r["joint"], r["load"], r["direction"]))].mean
        difference = wrong[key] - r["lsm_intercept_Nm"]
        lines.append([*r.values(), wrong[key], difference, clean[key], base])
        for name, (intercept, torque) in {
            "printed": (r["lsm_intercept_Nm"], r["tau_base_Nm"]),
            "simulated": (wrong[key], base),
            "clean": (clean[key], base),
        }.items():
            gaps[name].append(abs(intercept - torque))
        pose = {"load": "load", "no_load": "no load"}[r["load"]]
        shown.append(
            [
                f"{r['joint']} ({r['direction'].replace('-', '−')}) {pose}",
                signed(r["lsm_intercept_Nm"], 3),
                signed(wrong[key], 3),
                signed(difference, 3),
                signed(clean[key], 3),
                signed(r["tau_base_Nm"], 3),
                signed(base, 3),
                signed(base - r["tau_base_Nm"], 3),
            ]
        )
    said = say(
        "comparison", rows=len(lines), **{k: float(np.nanmedian(v)) for k, v in gaps.items()}
    )
    return write_table(
        item,
        folder,
        columns=[
            *thesis_table("4.4")[0],
            "simulated_intercept_Nm",
            "difference_intercept_Nm",
            "simulated_nothing_wrong_intercept_Nm",
            "simulated_tau_base_Nm",
        ],
        rows=lines,
        header=[
            "joint, pose",
            *("intercept [N·m]: measured", "simulated", "difference", "nothing wrong"),
            *("base torque [N·m]: measured", "simulated", "difference"),
        ],
        shown=shown,
        said=said,
    )


# ---- links ---------------------------------------------------------------------------------------


def _link_values(fit: LineFit) -> dict[tuple[int, str], float]:
    """Return what Table 4.1 has of every link, by its name there."""
    assert fit.links is not None
    out: dict[tuple[int, str], float] = {}
    for j, phi in enumerate(fit.links.phi):
        of = dict(zip(PARAMETERS, map(float, phi), strict=True))
        out[j + 1, "mass"] = of["m"]
        for axis in "xyz":
            out[j + 1, f"com_{axis}"] = of[f"m{axis}"] / of["m"]
        for ours, theirs in zip(
            ("Ixx", "Iyy", "Izz", "Ixy", "Iyz", "Ixz"),
            ("xx", "yy", "zz", "xy", "yz", "zx"),
            strict=True,
        ):
            out[j + 1, f"i_{theirs}"] = of[ours]
        out[j + 1, "coulomb"] = float(fit.links.coulomb[j])
        out[j + 1, "viscous"] = float(fit.links.viscous[j])
    return out


def write_links(item: Item, found: Found, folder: Path) -> Written:
    """Write Table 4.1: links by RosDyn's least squares."""
    fits = {w: found["lsm"][IIWA, w] for w in (NOTHING, ALL_WRONG)}
    wrong, clean = (_link_values(fits[w]) for w in (ALL_WRONG, NOTHING))
    rows = thesis_table("4.1")
    true = inertial_parameters(load_arm(IIWA).pinocchio())[:, 0]
    lines = []
    for r in rows:
        key = r["joint"], r["quantity"]
        lines.append([*r.values(), wrong[key], wrong[key] - r["value"], clean[key]])
    masses = {r["joint"]: r["value"] for r in rows if r["quantity"] == "mass"}
    printed = {(r["joint"], r["quantity"]): r["value"] for r in rows}
    shown = [
        [
            f"link {j}",
            short(m),
            short(wrong[j, "mass"]),
            signed(wrong[j, "mass"] - m, 1),
            short(clean[j, "mass"]),
            short(float(true[j - 1])),
            *(short(x[j, "coulomb"]) for x in (printed, wrong, clean)),
            *(short(x[j, "viscous"]) for x in (printed, wrong, clean)),
        ]
        for j, m in masses.items()
    ]
    links = fits[ALL_WRONG].links
    best = fits[NOTHING].links
    assert links is not None
    assert best is not None
    robot = thesis_robots()[IIWA]
    said = say(
        "links",
        printed_sum=sum(masses.values()),
        printed_negative=sum(m < 0 for m in masses.values()),
        simulated_sum=sum(wrong[j, "mass"] for j in masses),
        simulated_negative=len(links.negative_masses),
        impossible=len(links.impossible),
        clean_impossible=len(best.impossible),
        links=len(masses),
        weight=robot.weight_kg,
        started=[j for j, m in robot.start_kg.items() if abs(masses[j] - m) < 0.01],
        negative_friction=int((links.coulomb < 0).sum() + (links.viscous < 0).sum()),
        printed_friction=sum(printed[j, n] < 0 for j in masses for n in ("coulomb", "viscous")),
    )
    return write_table(
        item,
        folder,
        columns=[*rows[0], "simulated", "difference", "simulated_nothing_wrong"],
        rows=lines,
        header=[
            "",
            *("mass [kg]: measured", "simulated", "difference", "nothing wrong", "true"),
            *("Coulomb [N·m]: measured", "simulated", "nothing wrong"),
            *("viscous [N·m·s/rad]: measured", "simulated", "nothing wrong"),
        ],
        shown=shown,
        said=said,
    )


# ---- figures -------------------------------------------------------------------------------------


def _panel(axes: Axes, fit: LineFit, joint: int, title: str) -> None:
    """Draw friction torque over speed of one joint (from 1), and its two lines."""
    speed, torque = fit.speed[:, joint - 1], fit.torque[:, joint - 1]
    step = max(1, len(speed) // SHOWN_POINTS)
    axes.plot(speed[::step], torque[::step], ".", ms=2.2, color="0.6", mew=0)
    for direction, sign in (("+", 1), ("-", -1)):
        mine = fit.of(joint, direction)
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
    axes.grid(alpha=0.25, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False, loc="upper left")


def write_two_panels(item: Item, found: Found, folder: Path) -> Written:
    """Draw Figure 4.1: joints 7 and 1, with nothing wrong below."""
    fits = _fits(found)
    figure = Figure(figsize=(11, 7.6), layout="constrained")
    grid = figure.subplots(2, 2)
    for row, (wrong, words) in zip(
        grid, ((ALL_WRONG, "with all defects"), (NOTHING, "nothing wrong")), strict=True
    ):
        for axes, joint, letter in zip(row, (7, 1), "ab", strict=True):
            _panel(axes, fits[wrong], joint, f"({letter}) joint {joint}, {words}")
    return write_figure(item, folder, figure, say_two(fits, (1, 7)))


def write_seven_panels(item: Item, found: Found, folder: Path) -> Written:
    """Draw Figure A.1: all joints."""
    fits = _fits(found)
    figure = Figure(figsize=(11, 14.5), layout="constrained")
    grid = figure.subplots(4, 2).ravel()
    for joint in range(1, 8):
        _panel(grid[joint - 1], fits[ALL_WRONG], joint, f"({'abcdefg'[joint - 1]}) joint {joint}")
    grid[7].set_visible(False)
    return write_figure(item, folder, figure, say_lines(fits))
