"""Made-up measurements and paths for tests, not simulated."""

import dataclasses
from collections import defaultdict

import numpy as np

from stiction_envs.experiments.gte.protocol import Run
from stiction_envs.experiments.sje.protocol import Job, Measurement
from stiction_envs.measured.thesis_tables import thesis_base, thesis_table
from tests.experiments.gte.made_up import made_up as made_up_run


def measurement(job: Job, tau: float, iterations: int = 3) -> Measurement:
    return Measurement(
        job=job,
        tau=np.full(iterations, tau),
        start=np.zeros(iterations),
        start_torque=np.zeros(iterations),
        shaken_speed=np.zeros(1),
        traces=tuple(np.linspace(0, 0.15, 5, dtype=np.float32) for _ in range(iterations)),
        trace_dt=0.01,
    )


def run_torques(self, jobs, *, iterations=None, progress=None):
    """Pretend to simulate: base torques as printed, dither takes a tenth of its amplitude."""
    for job in jobs:
        c = job.configuration
        base = thesis_base(self.sticking.arm.name).tau[c.index]
        yield measurement(job, base - 0.1 * c.sign * job.amplitude_nm, iterations or 1)


def run_paths(self, cases, *, iterations=None, progress=None) -> list[Run]:
    """Pretend to run: constant errors whose sums over 200 samples are the printed ones."""
    runs, printed = [], defaultdict(list)
    for row in thesis_table("4.11"):
        stiffness = tuple(row[f"stiffness_{k}"] for k in ("translation", "rotation", "nullspace"))
        printed[row["trajectory"], stiffness].append(row)
    for case in cases:
        column = "mean_error_dither" if case.dithered else "mean_error_no_dither"
        size = np.array([row[column] for row in printed[case.trajectory, case.stiffness]]) / 200
        error = np.tile(size, (iterations or 10, 700, 1))
        run = made_up_run(error, iterations=iterations or 10, trajectory=case.trajectory)
        runs.append(dataclasses.replace(run, case=case))
    return runs
