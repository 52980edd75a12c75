"""A Single Joint Experiment for people: ``report.md``, ``report.html`` and one picture of all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stiction_envs.experiments.sje.plots import POSES, SIGNS, plot_torques
from stiction_envs.experiments.sje.protocol import Protocol
from stiction_envs.measured import SJERow
from stiction_envs.reporting.markdown import number, percent, signed, table_text
from stiction_envs.reporting.templates import write_md_and_html
from stiction_envs.robots.registry import arm_title

TEMPLATE = Path(__file__).parent / "templates" / "report.md.j2"
PICTURE = "torques.png"


def write_report(
    folder: Path,
    rows: Sequence[SJERow],
    *,
    robot: str,
    protocol: Protocol,
    pictures: Sequence[str],
    stuck: str = "",
    note: str = "",
) -> None:
    """Write both pages and the picture.

    Args:
        folder: an existing one, with the pictures.
        rows: of ``sje.csv``, at least one.
        robot: name of the arm.
        protocol: that the torques were measured by.
        pictures: of the iterations, names in the folder.
        stuck: what has no torque, one line.
        note: stands at the top.
    """
    plot_torques(rows, folder / PICTURE, robot=robot)
    by_joint: dict[int, list[float]] = {}
    for row in rows:
        if row.amplitude_nm and np.isfinite(row.reduction):
            by_joint.setdefault(row.joint, []).append(100 * row.reduction)
    reductions = {joint: float(np.mean(values)) for joint, values in by_joint.items()}
    by_torque = sorted(rows, key=lambda row: abs(row.tau_nm))
    write_md_and_html(
        folder,
        TEMPLATE,
        f"Breakaway torques of {arm_title(robot)}",
        note=note,
        robot=arm_title(robot),
        dithered=bool(reductions),
        mean=float(np.mean(list(reductions.values()))) if reductions else 0.0,
        reductions=reductions,
        best=max(reductions, key=reductions.__getitem__, default=0),
        least=min(reductions, key=reductions.__getitem__, default=0),
        worse=sorted(joint for joint, value in reductions.items() if value < 0),
        count=len({(row.joint, row.load, row.direction) for row in rows}),
        weakest=by_torque[0].joint,
        strongest=by_torque[-1].joint,
        lowest=abs(by_torque[0].tau_nm),
        highest=abs(by_torque[-1].tau_nm),
        iterations=max(row.iterations for row in rows),
        protocol=protocol,
        table=_table(rows),
        pictures=list(pictures),
        stuck=stuck,
    )


def _table(rows: Sequence[SJERow]) -> str:
    header = ["joint", "pose", "direction", "dither", "τ [N·m]", "std [N·m]", "change"]
    return table_text(
        header,
        [
            [
                str(row.joint),
                POSES[row.load],
                SIGNS[row.direction],
                f"{row.frequency_hz:g} Hz, {row.amplitude_nm:.3g} N·m" if row.amplitude_nm else "–",
                signed(row.tau_nm, 4),
                number(row.std_nm, 4),
                percent(-100 * row.reduction) if row.amplitude_nm else "",
            ]
            for row in rows
        ],
    )
