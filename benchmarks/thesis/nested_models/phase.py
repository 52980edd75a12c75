"""Dither at half the controller's rate: its amplitude is an accident of phase (thesis Table 4.5).

A controller of 200 Hz that computes A sin(2π 100 t + φ) and holds it sends ±A sin φ: whatever the
dither was meant to be, the joint gets between nothing and a square wave of A, and which of them is
decided by when the sine was started relative to the controller's clock (sources.md 2.6). Here the
iiwa's eight cells are simulated by the plant at several φ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job
from stiction_envs.experiments.sje.rig import SJERig
from stiction_envs.measured import DitheredRow, thesis_dithered, thesis_robots

Array = NDArray[np.float64]
(ROBOT,) = thesis_robots("4.5")
PHASES = 7
"""Phases from 0 to a quarter turn; the other quarters give the same ±A sin φ; assumed."""


class _PhasedRig(SJERig):
    """A rig whose dithers start at a chosen phase: the last number of a slot's key."""

    def approach(self, ids: NDArray[np.int64], keys: Sequence[tuple[int, ...]]) -> None:
        super().approach(ids, keys)
        turn = np.array([key[-1] for key in keys]) / (PHASES - 1)
        self.dither_phase[ids] = (np.pi / 2 * turn)[:, None]


class _Phased(SingleJointExperiment):
    """Single Joint Experiment in which a job's replica is the step of its phase."""

    def rig(self, nsim: int, **_: object) -> SJERig:
        return _PhasedRig(self, nsim)


@dataclass(frozen=True, kw_only=True)
class PhaseStudy:
    """Simulated changes over phase, and the measured ones."""

    rows: tuple[DitheredRow, ...]
    """The measured cells."""
    phase: Array
    """(P,) φ [rad]."""
    change: Array
    """(cells, P) simulated |τ_SJE|/|τ_base| − 1 [-]."""
    controller_rate_hz: float
    """Rate at which the command is computed [Hz]."""

    @property
    def measured(self) -> Array:
        """(cells,) measured change [-]."""
        return np.array([r.tau_sje_nm / r.tau_base_nm - 1.0 for r in self.rows])

    @property
    def over_random_phase(self) -> Array:
        """(cells,) mean change over a phase that is anything with equal chance [-]."""
        return np.asarray(np.trapezoid(self.change, self.phase, axis=1) / np.ptp(self.phase))

    @property
    def within(self) -> NDArray[np.bool_]:
        """(cells,) whether the measured change lies in what some phase gives."""
        low, high = self.change.min(axis=1), self.change.max(axis=1)
        return np.asarray((low <= self.measured) & (self.measured <= high))


def study_phase(
    *,
    rows: Sequence[DitheredRow] | None = None,
    threads: int = 0,
    progress: Callable[[float], None] | None = None,
) -> PhaseStudy:
    """Simulate measured cells at `PHASES` phases between dither and controller.

    Args:
        rows: the cells; None for all of the robot's.
        threads: threads, 0 for all processors.
        progress: called with the simulated seconds of every block, summed over simulations.

    Returns:
        Changes against the simulation's own base torques; without scatter, one ramp each.
    """
    chosen = tuple(thesis_dithered(ROBOT) if rows is None else rows)
    experiment = _Phased(ROBOT, scatter=False, threads=threads)
    where = [Configuration(r.joint, r.load, r.direction) for r in chosen]
    jobs = [
        [Job(c, r.frequency_hz, r.amplitude_nm, replica=k) for k in range(PHASES)]
        for c, r in zip(where, chosen, strict=True)
    ]
    flat = [Job(c) for c in dict.fromkeys(where)] + [j for group in jobs for j in group]
    tau = {m.job: m.mean for m in experiment.run(flat, iterations=1, progress=progress)}
    base = np.array([tau[Job(c)] for c in where])
    dithered = np.array([[tau[j] for j in group] for group in jobs])
    return PhaseStudy(
        rows=chosen,
        phase=np.linspace(0, np.pi / 2, PHASES),
        change=np.abs(dithered) / np.abs(base)[:, None] - 1.0,
        controller_rate_hz=float(experiment.interface.controller_rate_hz),
    )
