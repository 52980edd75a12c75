"""Page of `real_logs`: tables from the runs; the words are in `templates/real_logs.md.j2`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from stiction_envs.gap.causes import parameter_units
from stiction_envs.reporting.markdown import number, short, table_text
from stiction_envs.reporting.templates import render

Row = dict[str, Any]
TEMPLATE = Path(__file__).parent / "templates" / "real_logs.md.j2"
SWEEPS = ("1", "2", "3", "5", "6", "7")
ENDINGS = re.compile(r"_(nm_per_rad|nm_per_s|per_rev|kgm2|nms|nm|rad|kg|m|s)$")
"""Units at the ends of parameters' names."""
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
    summary, worse = _summary(rows)
    return render(
        TEMPLATE,
        pictures=pictures,
        summary=summary,
        worse=worse,
        cases={name: _case(name, row) for name, row in rows.items()},
        poses=_poses(rows["iiwa14 poses"]),
    )


def joints(rows: dict[str, Row]) -> list[tuple[str, int, Row]]:
    """Robot, joint and case of every joint that moved, or was in the poses."""
    sweeps = [rows[f"iiwa14 joint{j}"] for j in SWEEPS]
    iiwa = sorted(((j, k) for k, row in enumerate(sweeps) for j in row["shown"]))
    return [
        *(("panda", j, rows["panda"]) for j in rows["panda"]["shown"]),
        *(("iiwa14", j, sweeps[k]) for j, k in iiwa),
        *(("tx40", j, rows["tx40"]) for j in rows["tx40"]["shown"]),
    ]


def _summary(rows: dict[str, Row]) -> tuple[str, list[str]]:
    """All joints, and those that the tool leaves worse than people do today."""
    cells, worse = [], []
    for robot, j, row in joints(rows):
        rms = {k: v[j - 1] for k, v in row["rms"].items()}
        offset = rms.get("coulomb_viscous_offset")
        tool, best = rms["extended"], min(rms["coulomb_viscous"], offset or np.inf)
        worse += [f"{robot} {j}"] if tool > best else []
        cells.append(
            [
                f"{robot} {j}",
                short(rms["rigid"]),
                short(rms["coulomb_viscous"]),
                short(offset) if offset is not None else "in C+V",
                f"**{short(tool)}**",
                short(row["noise"][j - 1]),
                f"{number(100 * (1 - tool / rms['coulomb_viscous']), 0)} %",
                f"{number(100 * (1 - tool / best), 0)} %",
            ]
        )
    head = ["joint", "rigid", "C+V", "+offset", "tool", "noise", "tool below C+V", "below +offset"]
    return table_text(head, cells), worse


def _case(name: str, row: Row) -> dict[str, Any]:
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
    checks = ""
    if name in CHECKS:
        said = _said(row)
        found = [(readme, [s for s in said if word in s]) for readme, word in CHECKS[name]]
        checks = table_text(
            ["the README says", "the tool says"],
            [[readme, hits[0] if hits else "**not found**"] for readme, hits in found],
        )
    return {
        "name": name,
        "verdict": row["verdict"],
        "rows": row["rows"],
        "blocks": row["blocks"],
        "cutoff": f", cutoff {row['cutoff_hz']:.3g} Hz" if np.isfinite(row["cutoff_hz"]) else "",
        "seconds": row["seconds"],
        "causes": table_text(["cause", "joints", "gain", "parameters", "or"], cells),
        "checks": checks,
    }


def _parameter(key: str, p: dict[str, Any]) -> str:
    value = p["value"]
    text = ", ".join(short(x) for x in value) if isinstance(value, list) else short(value)
    unit = parameter_units().get(key, "")
    bound = " (on its bound)" if p["on_bound"] else ""
    return f"{ENDINGS.sub('', key) if unit else key} {text} {unit}".rstrip() + bound


def _poses(row: Row) -> str:
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
    return table_text(head, cells)
