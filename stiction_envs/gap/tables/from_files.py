"""Torque tables as files: base and dithered torques of one robot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.protocol import Configuration, configurations
from stiction_envs.measured import BaseTable, DitheredRow, SJERow, read_sje
from stiction_envs.measured.tables import our_name
from stiction_envs.robots import Arm

UNUSED_NM = 1.0
"""Base torque of joints where none was measured and none is used [N·m]; without effect."""


def read_tables(paths: Sequence[str | Path], arm: Arm) -> tuple[BaseTable, list[DitheredRow]]:
    """Read base torques and dithered torques of an arm from SJE tables.

    Args:
        paths: files in the form of ``sje.csv``; a base torque in several files must be the same.
        arm: the arm; rows of other robots are left out.

    Raises:
        StictionError: a file that cannot be read, no row of the arm, or a joint with dithered
            torques that lacks one of its four base torques.
    """
    rows = [(str(path), row) for path in paths for row in read_sje(path)]
    robots = list(dict.fromkeys(our_name(row.robot) for _, row in rows))
    if arm.name in robots or arm.registered:
        rows = [(path, row) for path, row in rows if our_name(row.robot) == arm.name]
    if not rows or (arm.name not in robots and len(robots) > 1):
        raise StictionError(
            f"{paths[0]}: torques of {', '.join(robots)}: expected robot {arm.name}"
        )
    base: dict[Configuration, float] = {}
    for path, row in rows:
        where = Configuration(row.joint, row.load, row.direction)
        if row.is_base and base.setdefault(where, row.tau_nm) != row.tau_nm:
            raise StictionError(
                f"{path}: base torque of joint {row.joint}, {row.load} {row.direction} is "
                f"{row.tau_nm:g} N·m and {base[where]:g} N·m: expected one"
            )
    dithered = [_dithered(path, row, base) for path, row in rows if row.amplitude_nm > 0]
    if not dithered:
        raise StictionError(f"{paths[0]}: base torques alone: expected rows with dither too")
    joints = sorted({x.joint for x in dithered})
    if joints[-1] > arm.n:
        raise StictionError(f"{paths[0]}: joint {joints[-1]}: {arm.name} has {arm.n}")
    for where in configurations(arm.n, joints):
        if where not in base:
            raise StictionError(
                f"{paths[0]}: joint {where.joint} has dithered torques, but no base torque in "
                f"{where.load} {where.direction}: expected all four"
            )
    tau = np.tile([UNUSED_NM, -UNUSED_NM], (arm.n, 2, 1))
    for where, value in base.items():
        if where.joint <= arm.n:
            tau[where.index] = value
    return BaseTable(arm.name, tau), dithered


def _dithered(path: str, row: SJERow, base: dict[Configuration, float]) -> DitheredRow:
    where = Configuration(row.joint, row.load, row.direction)
    if where not in base:
        raise StictionError(
            f"{path}: joint {row.joint}, {row.load} {row.direction} has dithered torques: "
            "expected its base torque too (a row with frequency and amplitude 0)"
        )
    same = ("robot", "joint", "load", "direction", "frequency_hz", "amplitude_nm")
    return DitheredRow(
        **{name: getattr(row, name) for name in same},
        scale=row.amplitude_nm / abs(base[where]),
        tau_base_nm=base[where],
        tau_sje_nm=row.tau_nm,
        change_pct=100 * (row.tau_nm / base[where] - 1),
        table=Path(path).name,
        amplitude_set="scale",
        outlier=False,
    )
