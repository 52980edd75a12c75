"""Tables to compare a search with: the thesis's and the protocol's."""

from __future__ import annotations

from stiction_envs.dither.tables import HERE
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.measured import AmplitudeRow, read_amplitudes, thesis_robots
from tuning.protocol.rules import frequencies_of
from tuning.search.bounds import Bounds, base_torques
from tuning.settings import TuningSettings

Table = tuple[AmplitudeRow, ...]
THESIS, PROTOCOL = "Table 4.9", "make tune"


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
