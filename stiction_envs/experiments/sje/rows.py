"""From measurements to table rows: the reduction needs the base run of the same configuration."""

from __future__ import annotations

import math
from collections.abc import Iterable

from stiction_envs.experiments.sje.protocol import DIRECTIONS, LOADS, Configuration, Measurement
from stiction_envs.measured.tables import SJERow


def is_base(m: Measurement) -> bool:
    """Whether nothing was added to the ramp."""
    return m.job.amplitude_nm == 0 and m.job.offset_nm == 0


def is_stuck(m: Measurement) -> bool:
    """Whether an iteration ended without reaching the threshold."""
    return not math.isfinite(m.mean)


def base_of(measurements: Iterable[Measurement]) -> dict[Configuration, Measurement]:
    """Return the undithered measurement of each configuration."""
    return {m.job.configuration: m for m in measurements if is_base(m)}


def in_order(measurements: Iterable[Measurement]) -> list[Measurement]:
    """Return measurements by joint, load, no load, +, −, then base before dithered."""

    def key(m: Measurement) -> tuple[float, ...]:
        c = m.job.configuration
        where = (c.joint, LOADS.index(c.load), DIRECTIONS.index(c.direction))
        return (*where, m.job.frequency_hz, m.job.amplitude_nm)

    return sorted(measurements, key=key)


def sje_rows(measurements: Iterable[Measurement], robot: str) -> list[SJERow]:
    """Return one row per measurement, in order; those with a stuck iteration have none.

    Args:
        measurements: base and dithered ones.
        robot: name for the robot column.

    Returns:
        Rows; `reduction` is 1 − |τ|/|τ_base| of the same configuration, 0 for a base row, NaN where
        no base torque is known. `std_nm` is NaN after a single iteration: it is not known.
    """
    ordered = in_order(measurements)
    base = base_of(ordered)
    rows = []
    for m in ordered:
        if is_stuck(m):
            continue
        c = m.job.configuration
        reference = base.get(c)
        tau_base = math.nan if reference is None else reference.mean
        plain = is_base(m)
        rows.append(
            SJERow(
                robot=robot,
                joint=c.joint,
                load=c.load,
                direction=c.direction,
                frequency_hz=0.0 if plain else m.job.frequency_hz,
                amplitude_nm=m.job.amplitude_nm,
                tau_nm=m.mean,
                std_nm=m.std if len(m.tau) > 1 else math.nan,
                iterations=len(m.tau),
                reduction=0.0 if plain else 1.0 - abs(m.mean) / abs(tau_base),
            )
        )
    return rows
