"""Rungs of the ladder: each predicts the change of torque of every cell.

Those without physics come first: a model must beat them. The physical ones are the whole-arm
simulation with the shipped parameters (physics.md 5.1) and with one mechanism taken out; nothing
is refitted after taking it out, so a rung shows what the mechanism does in *this* model.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from benchmarks.thesis_ladder.scoring import Cell
from stiction_envs.control.torque_path import TorqueInterface
from stiction_envs.experiments.protocol import Configuration, Job
from stiction_envs.experiments.sje import SingleJointExperiment
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.measured import thesis_base
from stiction_envs.robots import load_arm

ITERATIONS = 2


def nothing(cells: list[Cell]) -> np.ndarray:
    """Dither changes nothing."""
    return np.zeros(len(cells))


def lookup(cells: list[Cell]) -> np.ndarray:
    """The same configuration and frequency in Table 4.6, whatever the amplitude."""
    table = {(c.configuration, c.row.frequency_hz): c.change for c in cells if c.row.table == "4.6"}
    return np.array([table[c.configuration, c.row.frequency_hz] for c in cells])


def band(cells: list[Cell]) -> np.ndarray:
    """Stiction as a band: the dither's peak adds to the ramp, so that A less torque is needed."""
    return np.array(
        [max(0.0, 1.0 - c.row.amplitude_nm / abs(c.row.tau_base_nm)) - 1.0 for c in cells]
    )


def simulate(
    cells: list[Cell],
    friction: FrictionParameters,
    progress: Callable[[float], None],
    interface: TorqueInterface | None = None,
) -> np.ndarray:
    """Simulated change of every cell, against the simulation's own base torque."""
    arm = load_arm("panda")
    experiment = SingleJointExperiment.of(
        arm, friction=friction, interface=interface, scatter=False
    )
    jobs = [Job(c.configuration, c.row.frequency_hz, c.row.amplitude_nm) for c in cells]
    tau: dict[Job, float] = {}
    for m in experiment.run(
        [*experiment.jobs(), *dict.fromkeys(jobs)], iterations=ITERATIONS, progress=progress
    ):
        tau[m.job] = m.mean
    return np.array(
        [
            abs(tau[j]) / abs(tau[Job(c.configuration)]) - 1.0
            for j, c in zip(jobs, cells, strict=True)
        ]
    )


def asymmetric(friction: FrictionParameters) -> FrictionParameters:
    """What sees no offset: each direction's base torque is stiction of that direction.

    In the mean of the two poses; without load dependence, which would need a sign.
    """
    table = thesis_base("panda").tau
    now = friction.stiction_at(friction.load_high).mean(axis=1)
    half = thesis_base("panda").friction[:, 0]
    level = np.abs(table).mean(axis=1) * (now / half)[:, None]
    return friction.replace(
        stiction=level,
        load_coefficient=np.zeros(7),
        offset=np.zeros(7),
        gravity_error=np.zeros(7),
    )


def variants() -> dict[str, tuple[FrictionParameters, TorqueInterface | None]]:
    """Return the simulated rungs: parameters, and the torque interface where it differs."""
    full = load_friction("panda")
    arm = load_arm("panda")
    plain = dataclasses.replace(
        TorqueInterface.of(arm, lowpass_hz=0.0), torque_rate=np.full(7, np.inf)
    )
    zero = np.zeros(7)
    return {
        "rigid joints": (full.rigid(), None),
        "offset taken as asymmetric friction": (asymmetric(full), None),
        "without low-pass and rate limit": (full, plain),
        "without load dependence": (
            full.replace(
                stiction=full.stiction_at((full.load_low + full.load_high) / 2),
                load_coefficient=zero,
            ),
            None,
        ),
        "without ripple": (full.replace(ripple_amplitude=zero), None),
        "shipped model": (full, None),
    }


def with_drift(cells: list[Cell], predicted: np.ndarray) -> np.ndarray:
    """One factor per configuration on its base between measuring days, from Table 4.6 only.

    The factor is the median over the four frequencies of measured over predicted torque: a base
    that has moved shifts all its dithered torques alike.
    """
    ratio: dict[Configuration, list[float]] = {}
    for c, p in zip(cells, predicted, strict=True):
        if c.row.table == "4.6":
            ratio.setdefault(c.configuration, []).append((1.0 + c.change) / (1.0 + p))
    factor = {k: float(np.median(v)) for k, v in ratio.items()}
    return np.array(
        [factor[c.configuration] * (1.0 + p) - 1.0 for c, p in zip(cells, predicted, strict=True)]
    )
