"""Thesis cells on the whole arm: calibrated to Table 4.3, simulated by the plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.calibrate import calibrate
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.gap.tables.cells import Cell
from stiction_envs.measured import thesis_base, thesis_robots
from stiction_envs.robots import load_arm
from stiction_envs.thesis.fit import settings

Array = NDArray[np.float64]
(ROBOT,) = thesis_robots("4.6")
ITERATIONS = 2
"""Iterations per cell, without scatter: the second is free of how the first began."""


def start_friction() -> FrictionParameters:
    """Return the friction from which every fit starts: the priors' centres, not the shipped ones.

    Damping ratios, viscous friction and ripple are the robot's file's; levels are still to be
    calibrated.
    """
    shipped, priors = load_friction(ROBOT), settings()
    changes = {}
    for name, entry in priors.items():
        if "prior" in entry:
            now = getattr(shipped, name)
            prior = np.broadcast_to(np.array(entry["prior"], dtype=float), (shipped.n,))
            changes[name] = np.repeat(prior[:, None], 2, axis=1) if now.ndim == 2 else prior.copy()
    return shipped.replace(**changes)


def whole_arm(
    friction: FrictionParameters, chosen: Sequence[Cell], ramp_rate: float | None = None
) -> tuple[FrictionParameters, Array]:
    """Calibrate an arm's levels to Table 4.3 and simulate cells with the plant.

    Args:
        friction: of the arm; its levels are overwritten.
        chosen: cells to simulate.
        ramp_rate: [N·m/s], None for the protocol's.

    Returns:
        Calibrated parameters and (cells,) changes against the simulation's own base torque [-].
    """
    experiment = SingleJointExperiment(ROBOT, friction=friction, scatter=False)
    if ramp_rate is not None:
        protocol = experiment.protocol.replace(ramp_rate=ramp_rate)
        experiment = experiment.replace(protocol=protocol)
    fitted = calibrate(thesis_base(ROBOT), experiment).parameters
    experiment = experiment.replace(sticking=build(load_arm(ROBOT), fitted))
    return fitted, simulate(experiment, chosen)


def simulate(experiment: SingleJointExperiment, chosen: Sequence[Cell]) -> Array:
    """Return (cells,) simulated changes against the simulation's own base torques [-]."""
    jobs = [Job(c.configuration, c.row.frequency_hz, c.row.amplitude_nm) for c in chosen]
    bases = list(dict.fromkeys(Job(c.configuration) for c in chosen))
    run = experiment.run([*bases, *dict.fromkeys(jobs)], iterations=ITERATIONS)
    tau = {m.job: m.mean for m in run}
    return np.array([abs(tau[j]) / abs(tau[Job(j.configuration)]) - 1.0 for j in jobs])


def with_parameters(
    friction: FrictionParameters, found: Mapping[int, Mapping[str, float]]
) -> FrictionParameters:
    """Return friction with the named parameters of some joints (from 1) replaced."""
    changes = {}
    for name in dict.fromkeys(n for p in found.values() for n in p):
        value = np.array(getattr(friction, name))
        for joint, parameters in found.items():
            if name in parameters:
                value[joint - 1] = parameters[name]
        changes[name] = value
    return friction.replace(**changes)
