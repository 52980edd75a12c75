"""Which configurations are measured, and with which dither of an amplitude table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.protocol import DIRECTIONS, LOADS, Job, configurations
from stiction_envs.measured import AmplitudeRow, read_amplitudes
from stiction_envs.robots import Arm

Dither = str | Path | Sequence[AmplitudeRow]
"""An amplitude table, or its rows."""


def jobs_of(
    arm: Arm,
    interface: TorqueInterface,
    joints: Sequence[int] | None,
    *,
    loads: Sequence[str] = LOADS,
    directions: Sequence[str] = DIRECTIONS,
    dither: Dither | None = None,
) -> list[Job]:
    """Return undithered jobs, then those with the dither of a table.

    Args:
        arm: the arm.
        interface: says how fast a dither it takes.
        joints: 1..n; None for all.
        loads: poses.
        directions: of the ramp.
        dither: each joint under test is dithered by its row; None for no dither.

    Raises:
        StictionError: a joint the arm lacks, or a table that dithers none of the joints, that the
            arm cannot take, or that cannot be read.
    """
    chosen = list(joints) if joints is not None else None
    base = [
        Job(c)
        for c in configurations(arm.n, chosen)
        if c.load in loads and c.direction in directions
    ]
    if dither is None:
        return base
    tested = sorted({j.configuration.joint for j in base})
    rows = _rows(arm, interface, tested, dither)
    return base + [
        Job(
            job.configuration,
            frequency_hz=row.frequency_hz,
            amplitude_nm=row.amplitude_nm,
            waveform=row.waveform,
            offset_nm=row.offset_nm,
            gate_velocity=row.gate_velocity,
        )
        for job in base
        if (row := rows.get(job.configuration.joint)) is not None
    ]


def _rows(
    arm: Arm, interface: TorqueInterface, tested: list[int], dither: Dither
) -> dict[int, AmplitudeRow]:
    """Return the row of each joint that is dithered and tested."""
    where = str(dither) if isinstance(dither, str | Path) else "dither"
    rows = (
        read_amplitudes(
            dither,
            n_joints=arm.n,
            torque_limit=arm.limits.torque,
            controller_rate_hz=interface.controller_rate_hz,
        )
        if isinstance(dither, str | Path)
        else list(dither)
    )
    for row in rows:
        if row.amplitude_nm == 0 and row.offset_nm != 0:
            raise StictionError(
                f"{where}: joint {row.joint} has offset_nm {row.offset_nm:g} without amplitude: "
                "expected an amplitude_nm above 0, or no offset"
            )
    dithered = {row.joint: row for row in rows if row.amplitude_nm > 0}
    chosen = {j: row for j, row in dithered.items() if j in tested}
    if not chosen:
        has = ", ".join(map(str, sorted(dithered))) or "no joint"
        asked = ", ".join(map(str, tested))
        raise StictionError(f"{where}: dithers {has}, but the joints tested are {asked}")
    return chosen
