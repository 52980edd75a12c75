"""Page and pictures of `real_logs`: all joints, and each robot's residuals."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from benchmarks.harness import Row
from stiction_envs.gap.causes import parameter_units
from stiction_envs.reporting.markdown import number, short, table_text
from stiction_envs.reporting.png import save_small

SWEEP_JOINTS = (1, 2, 3, 5, 6, 7)
"""Joints of the iiwa 14 that have a log of their own."""
ENDINGS = re.compile(r"_(nm_per_rad|nm_per_s|per_rev|kgm2|nms|nm|rad|kg|m|s)$")
"""Units at the ends of parameters' names."""


def page(rows: dict[str, Row]) -> dict[str, Any]:
    """Return what the page's template asks for."""
    summary, below = _summary(rows)
    return {
        "summary": summary,
        "joints": len(below),
        "fewer": [name for name, percent in below.items() if percent > 0],
        "worse": [name for name, percent in below.items() if percent < 0],
        "below": [min(below.values()), max(below.values())],
        "cases": {name: _case(name, row) for name, row in rows.items()},
    }


def joints(rows: dict[str, Row]) -> list[tuple[str, int, Row]]:
    """Return robot, joint and case of every joint that moved, or was in the poses."""
    sweeps = [rows[f"iiwa14 joint{j}"] for j in SWEEP_JOINTS]
    iiwa = sorted(((j, k) for k, row in enumerate(sweeps) for j in row["shown"]))
    return [
        *(("panda", j, rows["panda"]) for j in rows["panda"]["shown"]),
        *(("iiwa14", j, sweeps[k]) for j, k in iiwa),
    ]


def _summary(rows: dict[str, Row]) -> tuple[str, dict[str, float]]:
    """Return the table of all joints, and by how much less the tool leaves than others [%]."""
    cells, below = [], {}
    for robot, j, row in joints(rows):
        rms = {k: v[j - 1] for k, v in row["rms"].items()}
        offset = rms["coulomb_viscous_offset"]
        tool, best = rms["extended"], min(rms["coulomb_viscous"], offset)
        below[f"{robot} {j}"] = 100 * (1 - tool / best)
        cells.append(
            [
                f"{robot} {j}",
                short(rms["rigid"]),
                short(rms["coulomb_viscous"]),
                short(offset),
                f"**{short(tool)}**",
                short(row["noise"][j - 1]),
                f"{number(100 * (1 - tool / rms['coulomb_viscous']), 0)} %",
                f"{number(below[f'{robot} {j}'], 0)} %",
            ]
        )
    head = ["joint", "rigid", "C+V", "+offset", "tool", "noise", "tool below C+V", "below +offset"]
    return table_text(head, cells), below


def _case(name: str, row: Row) -> dict[str, Any]:
    cells = []
    for cause in row["causes"]:
        by = cause["parameters"].get("by_joint", {"": cause["parameters"]})
        words = []
        for j, parameters in sorted(by.items()):
            inner = ", ".join(_parameter(k, v) for k, v in parameters.items() if k != "by_joint")
            words.append(inner if len(by) == 1 else f"{j}: {inner}")
        cells.append(
            [
                cause["name"],
                ", ".join(map(str, cause["joints"])) or "arm",
                f"{cause['gain_percent']:.1f} %",
                "; ".join(words),
                ", ".join(cause["confused_with"]),
            ]
        )
    return {
        "name": name,
        "verdict": row["verdict"],
        "rows": row["rows"],
        "blocks": row["blocks"],
        "cutoff": f", cutoff {row['cutoff_hz']:.3g} Hz" if np.isfinite(row["cutoff_hz"]) else "",
        "seconds": row["seconds"],
        "causes": table_text(["cause", "joints", "gain", "parameters", "or"], cells),
    }


def _parameter(key: str, p: dict[str, Any]) -> str:
    value = p["value"]
    text = ", ".join(short(x) for x in value) if isinstance(value, list) else short(value)
    unit = parameter_units().get(key, "")
    bound = " (on its bound)" if p["on_bound"] else ""
    return f"{ENDINGS.sub('', key) if unit else key} {text} {unit}".rstrip() + bound


# ---- pictures ------------------------------------------------------------------------------------

RIGID, USUAL, TOOL = "#c2590c", "0.45", "#1f5fa8"


def draw(rows: dict[str, Row], folder: Path) -> None:
    """Draw all pictures."""
    _overview(rows, folder / "real_logs.png")
    for robot in ("panda", "iiwa14"):
        mine = [(j, row) for r, j, row in joints(rows) if r == robot]
        _residuals(robot, mine, folder / f"real_logs_{robot}.png")


def _overview(rows: dict[str, Row], path: Path) -> None:
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    axes = figure.subplots()
    all_of = joints(rows)
    for k, (_, j, row) in enumerate(all_of):
        rms = {name: v[j - 1] for name, v in row["rms"].items()}
        usual = min(rms["coulomb_viscous"], rms["coulomb_viscous_offset"])
        axes.vlines(k, rms["extended"], rms["rigid"], color="0.8", lw=2, zorder=1)
        for y, colour, mark, text in (
            (rms["rigid"], RIGID, "o", "rigid"),
            (usual, USUAL, "s", "Coulomb, viscous, offset"),
            (rms["extended"], TOOL, "o", "tool"),
            (row["noise"][j - 1], "0.1", "_", "noise floor"),
        ):
            size = 14 if mark == "_" else 7
            axes.plot(k, y, mark, color=colour, ms=size, label=text if k == 0 else None)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xticks(range(len(all_of)), [f"{r}\n{j}" for r, j, _ in all_of], fontsize=8)
    axes.set_ylabel("held-out residual [N·m]")
    axes.legend(fontsize=8.5, frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0, 1))
    axes.grid(alpha=0.25, lw=0.6, axis="y")
    axes.spines[["top", "right"]].set_visible(False)
    save_small(figure, path)


def _residuals(robot: str, shown: list[tuple[int, Row]], path: Path) -> None:
    figure = Figure(figsize=(13, 1.9 * len(shown)), layout="constrained")
    grid = figure.subplots(len(shown), 3, squeeze=False, width_ratios=(2.2, 1, 1))
    for place, (line, (j, row)) in enumerate(zip(grid, shown, strict=True), 1):
        s = row["samples"][str(j - 1)]
        limit = 1.15 * np.percentile(np.abs(s["before"]), 99.5) + 1e-9
        for axes, x, label in zip(
            line, ("t", "dq", "q"), ("time [s]", "speed [rad/s]", "angle [rad]"), strict=True
        ):
            for key, colour in (("before", RIGID), ("after", TOOL)):
                axes.plot(s[x], s[key], ".", ms=2, mew=0, color=colour)
            axes.set_ylim(-limit, limit)
            _tidy(axes)
            if place == len(shown):
                axes.set_xlabel(label, fontsize=9)
        line[0].set_ylabel(f"joint {j}\nresidual [N·m]", fontsize=9)
    figure.suptitle(
        f"{robot}: measured less modelled torque; orange rigid, blue the tool's model",
        fontsize=10.5,
        x=0.01,
        ha="left",
    )
    save_small(figure, path)


def _tidy(axes: Axes) -> None:
    axes.axhline(0, color="0.6", lw=0.7, zorder=0)
    axes.grid(alpha=0.25, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
