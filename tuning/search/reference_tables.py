"""Tables to compare a search with: the thesis's, the protocol's, the best of its grid."""

from __future__ import annotations

from collections.abc import Sequence

from stiction_envs.dither.tables import HERE
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.measured import AmplitudeRow, read_amplitudes, thesis_robots
from stiction_envs.reporting.json_text import JsonRecord
from tuning.protocol.rules import frequencies_of
from tuning.search.bounds import Bounds, base_torques
from tuning.settings import TuningSettings
from tuning.study.record import LIMITS

Table = tuple[AmplitudeRow, ...]
THESIS, PROTOCOL, GRID = "Table 4.9", "make tune", "best grid point"


def reference_tables(
    experiment: SingleJointExperiment, bounds: Bounds, settings: TuningSettings
) -> dict[str, Table]:
    """Return the reference tables of an arm by name; the first limits a search.

    An arm without any gets the protocol's rule of thumb: the base torque at its second lowest
    frequency, or at its only one.
    """
    robot, out = experiment.sticking.arm.registered_name, {}
    if robot in thesis_robots("4.9"):
        out[THESIS] = thesis_final_dither()
    shipped = HERE / f"{robot}.csv"
    if shipped.exists():
        out[PROTOCOL] = tuple(read_amplitudes(shipped, n_joints=experiment.n))
    if not out:
        frequency = sorted(frequencies_of(robot, settings.thesis))[:2][-1]
        out["base torque"] = tuple(
            AmplitudeRow(j, frequency, min(base, bounds.largest(j, frequency)))
            for j, base in enumerate(base_torques(experiment).tolist(), 1)
        )
    return out


def grid_rows(
    experiment: SingleJointExperiment, bounds: Bounds, settings: TuningSettings
) -> tuple[AmplitudeRow, ...]:
    """Return every setting of the thesis's grid, of all joints."""
    robot = experiment.sticking.arm.registered_name
    half = experiment.interface.controller_rate_hz / 2
    return tuple(
        AmplitudeRow(j, f, min(scale * base, bounds.largest(j, f)))
        for j, base in enumerate(base_torques(experiment).tolist(), 1)
        for f in frequencies_of(robot, settings.thesis)
        for scale in settings.thesis.scales
        if f < half and bounds.forbidden(j, f) <= 0
    )


def best_of_grid(n: int, rows: Sequence[AmplitudeRow], measured: Sequence[JsonRecord]) -> Table:
    """Return the best allowed setting of every joint; no dither where none is allowed.

    Args:
        n: number of joints.
        rows: settings.
        measured: user attributes of the settings' trials.
    """
    out = []
    for j in range(1, n + 1):
        kept = [
            (found["left"], k)
            for k, (row, found) in enumerate(zip(rows, measured, strict=True))
            if row.joint == j and found.get("left", 1.0) < 1.0 and max(found[LIMITS]) <= 0
        ]
        out.append(rows[min(kept)[1]] if kept else AmplitudeRow(j, 0.0, 0.0))
    return tuple(out)
