"""What a report says of motions that the coefficients have not seen: tables and a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from stiction_envs.gap.check import Check
from stiction_envs.gap.diagnosis import Diagnosis
from stiction_envs.gap.left_out_motion import LeftOutMotion
from stiction_envs.gap.report_figures import AFTER, BEFORE, Drawn, clock, trace
from stiction_envs.gap.report_scores import draw_pairs
from stiction_envs.reporting.markdown import listed, number, percent, short, table_text
from stiction_envs.reporting.png import save_small

Array = NDArray[np.float64]
JOINTS = 3
"""Joints whose residual is drawn over time: those that are worse, else those that gain most."""


def check_errors(check: Check, d: Diagnosis) -> str:
    """Return the table of errors on the check logs."""
    rows = []
    for j, (before, after) in enumerate(zip(check.nominal_rms, check.extended_rms, strict=True)):
        change = percent(100 * (after / before - 1), 0) if before > 0 else "–"
        rows.append(
            [
                f"joint {j + 1}",
                short(before),
                short(after),
                change,
                short(check.noise[j]),
                short(d.extended_rms[j]),
                "**worse**" if j + 1 in check.worse_joints else "holds",
            ]
        )
    header = ["joint", "nominal [N·m]", "extended [N·m]", "change", "noise floor [N·m]"]
    return table_text([*header, "held out in the diagnosis [N·m]", ""], rows)


def check_causes(check: Check) -> str:
    """Return the table of causes on the check logs; nothing without any."""
    least = check.data.settings.check.least_torque * check.noise
    rows = []
    for x in check.transfers:
        for j in np.flatnonzero(x.torque > least):
            harmed = "**does not transfer**" if x.fails else "makes it worse"
            rows.append(
                [
                    x.name,
                    f"joint {j + 1}",
                    short(x.torque[j]),
                    short(x.without[j]),
                    short(check.extended_rms[j]),
                    number(x.share[j], 2),
                    harmed if j + 1 in x.harmed else "",
                ]
            )
    header = ["cause", "", "its torque [N·m]", "error without it [N·m]", "with it [N·m]"]
    return table_text([*header, "came true", ""], rows) if rows else ""


def left_out_errors(left_out: LeftOutMotion, d: Diagnosis) -> str:
    """Return the table of errors with one motion left out."""
    rows = []
    for j in range(len(left_out.nominal_rms)):
        worst = int(np.nanargmax(left_out.extended[:, j]))
        rows.append(
            [
                f"joint {j + 1}",
                short(left_out.nominal_rms[j]),
                short(d.extended_rms[j]),
                short(left_out.extended_rms[j]),
                f"{short(left_out.extended[worst, j])} (`{left_out.motions[worst]}`, "
                f"nominal {short(left_out.nominal[worst, j])})",
            ]
        )
    header = ["joint", "nominal [N·m]", "blocks of time left out [N·m]"]
    return table_text([*header, "motions left out [N·m]", "of them the worst [N·m]"], rows)


def left_out_causes(left_out: LeftOutMotion) -> str:
    """Return the table of causes on motions that were left out; nothing without any."""
    rows = []
    for c in left_out.causes:
        named = listed(f"`{x}`" for x in c.motions)
        many = named if len(c.motions) < 3 else f"{len(c.motions)} motions"
        strong = f"**{c.verdict}**" if c.verdict == "does not transfer" else c.verdict
        cells = [short(c.without_nm), short(c.with_nm), number(c.share, 2)]
        rows.append([c.name, f"joint {c.joint}", many or "none", *cells, strong])
    header = ["cause", "", "judged on", "error without it [N·m]", "with it [N·m]", "came true", ""]
    return table_text(header, rows) if rows else ""


def draw_check(check: Check, path: Path) -> Drawn:
    """Draw both models on the check logs: errors of each joint, residuals over time below."""
    n = len(check.noise)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(check.extended_rms / check.nominal_rms, nan=1.0)
    order = np.argsort(-ratio if check.worse_joints else ratio, kind="stable")
    many = min(JOINTS, n, len(check.worse_joints) or n)
    shown = sorted(int(j) for j in order[:many])
    figure = Figure(figsize=(10.5, 3.0 + 1.7 * len(shown)), layout="constrained")
    grid = figure.add_gridspec(1 + len(shown), 1, height_ratios=[1.6, *[1.0] * len(shown)])
    top = figure.add_subplot(grid[0])
    draw_pairs(top, check.nominal_rms, check.extended_rms)
    top.plot(np.arange(n), check.noise, "_", color="0.1", ms=26, mew=1.6)
    top.set_ylabel("error on the check logs\n[N·m]", fontsize=9)
    for label in (x for j, x in enumerate(top.get_xticklabels()) if j + 1 in check.worse_joints):
        label.set_color("#b00020")
        label.set_fontweight("bold")
    data, time = check.data, clock(check.data)
    for k, j in enumerate(shown):
        axes = figure.add_subplot(grid[1 + k])
        for torque, colour in ((data.nominal, BEFORE), (check.extended, AFTER)):
            trace(axes, time, data.tau[:, j] - torque[:, j], data, colour, "", 0.9)
        axes.axhline(0, color="0.6", lw=0.7, zorder=0)
        axes.set_title(f"joint {j + 1}", fontsize=9, loc="left")
        axes.set_ylabel("residual\n[N·m]", fontsize=9)
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.25, lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("time, segments one after another [s]", fontsize=9)
    lines = [(BEFORE, "nominal model"), (AFTER, "extended model"), ("0.1", "noise floor")]
    figure.legend(
        [Line2D([], [], color=c, lw=2) for c, _ in lines],
        [name for _, name in lines],
        loc="outside upper right",
        ncols=3,
        fontsize=9,
        frameon=False,
    )
    figure.suptitle(f"logs that took no part: the model {check.verdict}", x=0.02, ha="left")
    save_small(figure, path)
    worse = "the joints that are worse" if check.worse_joints else "the joints that gain most"
    return Drawn(
        path.name,
        "Root mean square error of both models on logs that took no part, and their residuals over "
        f"time on {worse}.",
    )
