"""What a Generated Trajectory Experiment is asked: start, path by name or file, table of dither."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.control.compensation import Compensation
from stiction_envs.control.trajectory import Path, read_path
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.gte.protocol import TRAJECTORIES, Case
from stiction_envs.measured import AmplitudeRow, read_amplitudes
from stiction_envs.robots import Arm

Stiffness = tuple[float, float, float]


def read_trajectory(text: str | File) -> Path | None:
    """Return the path of a CSV file; None for a path by name.

    Raises:
        StictionError: neither a name nor a CSV that can be read.
    """
    if str(text) in TRAJECTORIES:
        return None
    if not str(text).lower().endswith(".csv"):
        raise unknown("trajectory", str(text), [*TRAJECTORIES, "a path to a .csv"])
    return read_path(str(text))


def start_angles(arm: Arm, start: ArrayLike | None) -> NDArray[np.float64]:
    """Return the joint angles (n,) [rad] at which arms start, the rest pose for None.

    Raises:
        StictionError: not n numbers, or one that is not within the limits.
    """
    try:
        q = np.array(arm.rest if start is None else start, dtype=float)
    except (TypeError, ValueError):
        raise StictionError(f"start {start!r}: expected {arm.n} angles in rad") from None
    if q.shape != (arm.n,):
        given = f"{q.size} angles" if q.ndim == 1 else f"shape {q.shape}"
        raise StictionError(f"start: {given}: expected {arm.n}, one per joint of {arm.name}")
    low, high = arm.limits.position.T
    for j in np.flatnonzero(~((q > low) & (q < high))):
        raise StictionError(
            f"start: joint {j + 1}: {q[j]:g} rad: expected angles within the limits, "
            f"{low[j]:g} to {high[j]:g}"
        )
    return q


def read_dither(
    table: str | File, arm: Arm, *, waveform: str | None = None
) -> tuple[AmplitudeRow, ...]:
    """Return the rows of an amplitude table that an arm can take.

    Args:
        table: the file.
        arm: says how strong and fast a dither it takes.
        waveform: of every joint; None for the table's.

    Raises:
        StictionError: a table that cannot be read, that dithers no joint, or too much.
    """
    rows = read_amplitudes(
        table,
        n_joints=arm.n,
        torque_limit=arm.limits.torque,
        controller_rate_hz=arm.controller_rate_hz,
    )
    if not any(row.amplitude_nm > 0 for row in rows):
        raise StictionError(f"{table}: dithers no joint: expected an amplitude_nm above 0")
    if waveform is not None:
        rows = [dataclasses.replace(row, waveform=waveform) for row in rows]
    return tuple(rows)


def with_and_without(
    trajectory: str,
    stiffness: Stiffness,
    dither: Sequence[AmplitudeRow] = (),
    *,
    gate_velocity: float | None = None,
    phases: str | None = None,
    compensation: Compensation | None = None,
) -> list[Case]:
    """Return the case without anything, then those with dither, with compensation, with both.

    Args:
        trajectory: name of the path.
        stiffness: translational [N/m], rotational [N·m/rad], nullspace [N·m/rad].
        dither: of each dithered joint; empty for none.
        gate_velocity: of the dither [rad/s]; None for no gate.
        phases: of the joints' dithers; None for the default.
        compensation: of the joints' friction; None for none.
    """
    cases = [Case(trajectory=trajectory, stiffness=stiffness)]
    if dither:
        options = {"gate_velocity": gate_velocity, "phases": phases}
        given: dict[str, Any] = {k: v for k, v in options.items() if v is not None}
        cases.append(dataclasses.replace(cases[0], dither=tuple(dither), **given))
    if compensation is not None:
        cases += [dataclasses.replace(case, compensation=compensation) for case in cases]
    return cases
