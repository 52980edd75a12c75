"""Page and pictures of `real_logs`: numbers from the runs, words of what is in the data."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from stiction_envs.gap.causes import parameter_units
from stiction_envs.reporting.markdown import short, table
from stiction_envs.reporting.png import save_small

Row = dict[str, Any]
RIGID, USUAL, TOOL = "#c2590c", "0.45", "#1f5fa8"
SWEEPS = ("1", "2", "3", "5", "6", "7")
ENDINGS = re.compile(r"_(nm_per_rad|nm_per_s|per_rev|kgm2|nms|nm|rad|kg|m|s)$")
"""Units at the ends of parameters' names."""
WORDS = {
    "panda": """In every joint the rigid body leaves a step where the motion turns round, half
of it 0.15 to 0.55 N·m, on a torque that is measured behind the gear: friction of bearings and
seals on the link side, or what the maker's calibration leaves of the gear's. That is what Gaz
et al. fit to this log too (Coulomb, viscous, an offset per joint). Joints 1 and 2 have a bias
beside it, of −0.2 and −0.55 N·m. What was on the flange is not documented: gravity's causes
(payload, tilt, springs, offsets) share this bias in a way that one log of 20 s does not
settle, and small ones among them are to be read as "something of gravity is wrong here".

Friction turns round 35 to 50 ms after the sign of q̇ in joints 3, 5, 6 and 7, one to three
milliradians of way. That may be bristles; it may as well be that `q` is the commanded
position, as the tool says from its spectrum (at 16 to 32 Hz dq shakes with the torque and q
does not), and runs ahead of the arm. With such a `q` presliding cannot be measured, and
neither can stiction: the motion never creeps, and the filter that this log needs, below 4 Hz,
rounds off each reversal.""",
    "iiwa14": """The torques have the opposite sign (README), and the tool finds that without
being told. It also finds what the README only warns of: torques come some 100 ms after the
angles. On joint 4, which only holds while joint 2 moves, they do so too, so friction has no part
in it. In the sweeps of joints 2 and 7 the lag is beyond doubt before anything else is known, as a
delay and a low-pass of 110 ms together, and is undone; what that correction leaves in joint 2 is
named, as an actuator_delay of 10 ms. In those of joints 1, 3, 5 and 6 it comes out as the cause
actuator_delay, "torque is late in the log (measured late, or behind a filter)", found in each by
itself at 80 to 140 ms: one channel for the whole robot, and much the same in all recordings.
Friction is late with the rest. Left as it is, the lag looks like bristles that give way over a
hundredth of a radian, or like a link without inertia, since the filter takes the peaks off.

Masses: in 996 poses every loaded joint carries more than the model says, joint 2 by 17 %,
joint 4 by 27 %, joint 6 by a factor of three. One mass of 1.1 kg does it, but 5 cm *behind*
the flange: not a tool, but a wrist that is heavier than in the model, or a mounting around
it. The tool has no name for a heavier link; it says payload, with the centre of mass where it is,
and a torque scale of joint 5, which is no sensor's either. Free masses of all links and offsets
leave what repeated poses scatter in joints 1, 2, 4 and 7, and two to three times that in 3, 5 and
6; the tool stands between those and offsets with scales. Joint 1 has a bias of 0.7 N·m about a
vertical axis: the zero of its sensor, or a cable, since no gravity acts there.

Sweeps are judged beside the model that the poses gave (`--nominal model.toml`), since the
motion of one joint says little of gravity. Their friction is Coulomb's with little slope: 1.1
N·m in joint 1, 0.65 in joint 2, 0.33 in joint 7, 0.15 in joint 3, 0.07 in joint 6 and next to
nothing in joint 5. Joint 7's falls by a tenth from the slow runs to the fast ones, which came
later: speed and time cannot be told apart, and neither is named. Joint 3's residual is a smooth
hump over its angle, the same at every speed and in both directions, which is no friction: a hose or
cable, but no spring of constant stiffness, which is why most of it is left. Joints that only hold
while another sweeps can carry any torque within their friction: their offsets are named "or
coulomb_friction", and may be left over from how they came to rest. These torques were filtered
before they were logged, so that the noise floor of joints 3, 5 and 6 is far below what any model of
friction reaches.""",
    "tx40": """No masses of this robot are published. A rigid body is fitted to the same log
together with friction (axes from the manual's lengths; the other wrist motor counts as
mechanics), taken off, and the tool sees what is left: friction, and what the fit got wrong.
So its numbers say nothing of masses, and a little of the fit has seen the held-out blocks.
Torque is in front of the gear: friction is ten times that of the arms with link-side sensors.
The larger part grows with speed, but less than in proportion (see the curves over speed:
steep below 1 rad/s, flat above 3): a straight line leaves an S on either side, and none of
the seventeen causes is that curve. Joint 4's torque ripples some 31 times a turn. At rest,
after 7.4 s, the torque creeps by some N·m within the friction band. The scale of the drives'
signal is not documented, and so is not that of anything here.""",
}
CHECKS = {
    "panda": (
        ("1131 repeated rows", "1131 rows repeated"),
        ("120 rows with an old q", "old q"),
        ("PC clock; robot samples on whole milliseconds", "regular 1 ms clock"),
        ("dq lags the derivative of q by 5 ms", "dq lags the derivative of q by 5"),
        ("q may be the desired position", "may be the commanded position"),
    ),
    "iiwa14 joint2": (
        ("torque has the opposite sign", "opposite sign"),
        ("channels not time-aligned", "later than the angles"),
        ("dq is low-passed by the driver", "low-passed, half its power"),
        ("runs with a clock of their own", "recordings in one file"),
    ),
    "iiwa14 poses": (("torque has the opposite sign", "opposite sign"),),
    "tx40": (("7.4 s of motion, then rest", "the arm rests in"),),
}
"""What a README says, and the tool's words for it."""


def _said(row: Row) -> list[str]:
    return [*(t for _, t in row["corrections"]), *(t for _, t in row["warnings"]), *row["notes"]]


def page(rows: dict[str, Row], pictures: list[str]) -> str:
    """The Markdown of ``real_logs.md``."""
    lines = [
        "# Real logs: what today's models leave, what the tool leaves, what it names",
        "",
        "Made by `python benchmarks/real_logs.py` from three robots that others recorded "
        "(../shared/measured; not part of this project, and read only). Torque residual in N·m, "
        "root mean square on blocks of time that were held out. *Rigid*: published parameters "
        "(MuJoCo Menagerie), no friction. *C+V*: plus Coulomb and viscous friction per joint, what "
        "people do today; *+offset*: and a constant. *Tool*: the model of `stiction diagnose`. "
        "*Noise*: its estimate of what no model can explain.",
        "",
        f"![all joints]({pictures[0]})",
        "",
        *_summary(rows),
    ]
    for robot, title, names in (
        ("panda", "Panda, excitation run", ["panda"]),
        ("iiwa14", "iiwa 14, one joint at a time, and poses at rest", _of(rows, "iiwa14")),
        ("tx40", "Stäubli TX40, friction only", ["tx40"]),
    ):
        lines += [f"## {title}", "", *_paragraphs(WORDS[robot]), ""]
        lines += [f"![{robot}](real_logs_{robot}.png)", ""]
        for name in names:
            lines += _case(name, rows[name])
        if robot == "iiwa14":
            lines += _poses(rows["iiwa14 poses"])
    return "\n".join(lines).rstrip("\n") + "\n"


def _of(rows: dict[str, Row], start: str) -> list[str]:
    return [k for k in rows if k.startswith(start)]


def _paragraphs(text: str) -> list[str]:
    parts = [" ".join(p.split()) for p in text.split("\n\n")]
    return [x for p in parts for x in (p, "")][:-1]


def joints(rows: dict[str, Row]) -> list[tuple[str, int, Row]]:
    """Robot, joint and case of every joint that moved, or was in the poses."""
    sweeps = [rows[f"iiwa14 joint{j}"] for j in SWEEPS]
    iiwa = sorted(((j, k) for k, row in enumerate(sweeps) for j in row["shown"]))
    return [
        *(("panda", j, rows["panda"]) for j in rows["panda"]["shown"]),
        *(("iiwa14", j, sweeps[k]) for j, k in iiwa),
        *(("tx40", j, rows["tx40"]) for j in rows["tx40"]["shown"]),
    ]


def _summary(rows: dict[str, Row]) -> list[str]:
    cells = []
    for robot, j, row in joints(rows):
        rms = {k: v[j - 1] for k, v in row["rms"].items()}
        offset = rms.get("coulomb_viscous_offset")
        tool, best = rms["extended"], min(rms["coulomb_viscous"], offset or np.inf)
        cells.append(
            [
                f"{robot} {j}",
                short(rms["rigid"]),
                short(rms["coulomb_viscous"]),
                short(offset) if offset is not None else "in C+V",
                f"**{short(tool)}**",
                short(row["noise"][j - 1]),
                f"{100 * (1 - tool / rms['coulomb_viscous']):.0f} %",
                f"{100 * (1 - tool / best):.0f} %",
            ]
        )
    worse = [c[0] for c in cells if c[-1].startswith("-")]
    text = (
        f"Worse than Coulomb, viscous and offset: {', '.join(worse)}."
        if worse
        else "Nowhere worse than Coulomb, viscous and offset."
    )
    head = ["joint", "rigid", "C+V", "+offset", "tool", "noise", "tool below C+V", "below +offset"]
    return [
        *table(head, cells),
        f"{text} iiwa14 joint 4 is the one that holds while joint 2 moves. For the TX40 *rigid* is "
        "a body fitted to the log, with offsets.",
        "",
    ]


def _case(name: str, row: Row) -> list[str]:
    cells = []
    for cause in row["causes"]:
        found = cause["parameters"]
        by = found.get("by_joint", {str(cause["joints"][0]) if cause["joints"] else "arm": found})
        words = []
        for j, parameters in sorted(by.items()):
            arm = len(by) == 1 and len(cause["joints"]) != 1
            inner = ", ".join(_parameter(k, v) for k, v in parameters.items() if k != "by_joint")
            words.append(inner if arm or len(by) == 1 else f"{j}: {inner}")
        cells.append(
            [
                cause["name"],
                ", ".join(map(str, cause["joints"])) or "arm",
                f"{cause['gain_percent']:.1f} %",
                "; ".join(words),
                ", ".join(cause["confused_with"]),
            ]
        )
    lines = [
        f"### {name}: {row['verdict']}",
        "",
        f"{row['rows']} samples, {row['blocks']} blocks"
        + (f", cutoff {row['cutoff_hz']:.3g} Hz" if np.isfinite(row["cutoff_hz"]) else "")
        + f", {row['seconds']:.0f} s.",
        "",
        *table(["cause", "joints", "gain", "parameters", "or"], cells),
    ]
    if name in CHECKS:
        said = _said(row)
        found = []
        for readme, word in CHECKS[name]:
            hits = [s for s in said if word in s]
            found.append([readme, hits[0] if hits else "**not found**"])
        lines += table(["the README says", "the tool says"], found)
    return lines


def _parameter(key: str, p: dict[str, Any]) -> str:
    value = p["value"]
    text = ", ".join(short(x) for x in value) if isinstance(value, list) else short(value)
    unit = parameter_units().get(key, "")
    bound = " (on its bound)" if p["on_bound"] else ""
    return f"{ENDINGS.sub('', key) if unit else key} {text} {unit}".rstrip() + bound


def _poses(row: Row) -> list[str]:
    names = {
        "rigid": "rigid",
        "offset": "offset per joint",
        "offset_scale": "offset and scale per joint",
        "extended": "tool",
        "any_masses": "offsets, and any masses of all links",
    }
    cells = [[text, *(short(x) for x in row["rms"][key])] for key, text in names.items()]
    cells.append(["noise: poses taken twice", *(short(x) for x in row["noise"])])
    head = ["poses", *(f"joint {j + 1}" for j in range(7))]
    return [
        "What the poses can say of gravity, held out [N·m]:",
        "",
        *table(head, cells),
    ]


# ---- pictures --------------------------------------------------------------------------------


def draw(rows: dict[str, Row], folder: Path) -> list[str]:
    """All pictures; their names."""
    names = ["real_logs.png"]
    _overview(rows, folder / names[0])
    for robot in ("panda", "iiwa14", "tx40"):
        names.append(f"real_logs_{robot}.png")
        mine = [(j, row) for r, j, row in joints(rows) if r == robot]
        _residuals(robot, mine, folder / names[-1])
    return names


def _overview(rows: dict[str, Row], path: Path) -> None:
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    axes = figure.subplots()
    all_of = joints(rows)
    for k, (_, j, row) in enumerate(all_of):
        rms = {name: v[j - 1] for name, v in row["rms"].items()}
        usual = min(rms["coulomb_viscous"], rms.get("coulomb_viscous_offset", np.inf))
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
    for number, (line, (j, row)) in enumerate(zip(grid, shown, strict=True), 1):
        s = row["samples"][j - 1]
        limit = 1.15 * np.percentile(np.abs(s["before"]), 99.5) + 1e-9
        for axes, x, label in zip(
            line, ("t", "dq", "q"), ("time [s]", "speed [rad/s]", "angle [rad]"), strict=True
        ):
            for key, colour in (("before", RIGID), ("after", TOOL)):
                axes.plot(s[x], s[key], ".", ms=2, mew=0, color=colour)
            axes.set_ylim(-limit, limit)
            _tidy(axes)
            if number == len(shown):
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
