"""The studies behind the items: each is run once, for the parts that items ask for."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.thesis.items import Found
from benchmarks.thesis.lsm import fit_lines, friction_curve
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Measurement
from stiction_envs.measured.thesis_tables import thesis_robots

TRACE_POINTS = 150
"""Most points kept of a trace (assumed)."""
(ROBOT,) = thesis_robots("4.11")
Tell = Callable[[str, float, float], None]


@dataclass(frozen=True, kw_only=True)
class Options:
    """How studies are run."""

    seed: int = 0
    iterations: int | None = None
    """None for the thesis's."""
    scatter: bool = True
    threads: int = 0

    @property
    def arm(self) -> dict[str, Any]:
        """Arguments of an experiment."""
        return {"scatter": self.scatter, "seed": self.seed, "threads": self.threads}


def _curves(parts: Sequence[str], how: Options) -> Iterator[tuple[Any, Any]]:
    for robot in parts:
        yield robot, friction_curve(robot, threads=how.threads)


def _lines(parts: Sequence[tuple[str, str]], how: Options) -> Iterator[tuple[Any, Any]]:
    for robot, wrong in parts:
        yield (robot, wrong), fit_lines(robot, wrong, seed=how.seed)


def _thinned(m: Measurement) -> Measurement:
    """Return a measurement with at most `TRACE_POINTS` of each trace, for pictures."""
    stride = max(1, -(-max(len(t) for t in m.traces) // TRACE_POINTS))
    traces = (np.round(t[stride - 1 :: stride].astype(float), 6) for t in m.traces)
    return replace(
        m, traces=tuple(t.astype(np.float32) for t in traces), trace_dt=m.trace_dt * stride
    )


def _torques(parts: Sequence[Any], how: Options) -> Iterator[tuple[Any, Any]]:
    for robot in dict.fromkeys(robot for robot, _ in parts):
        jobs = [job for other, job in parts if other == robot]
        for m in SingleJointExperiment(robot, **how.arm).run(jobs, iterations=how.iterations):
            yield (robot, m.job), _thinned(m)


def _paths(parts: Sequence[Any], how: Options) -> Iterator[tuple[Any, Any]]:
    """Yield runs and measures of each path and stiffness: without dither, and with the final."""
    arm = GeneratedTrajectoryExperiment(ROBOT, **how.arm)
    for trajectory, stiffness in parts:
        dithers = ((), thesis_final_dither())
        cases = [Case(trajectory=trajectory, stiffness=stiffness, dither=d) for d in dithers]
        runs = [run for c in cases for run in arm.run([c], iterations=how.iterations)]
        both = tuple((run, Measures(run, arm.protocol, arm.motion)) for run in runs)
        yield (trajectory, stiffness), both


STUDIES: dict[str, tuple[str, Callable[[Any, Options], Iterator[tuple[Any, Any]]]]] = {
    "curve": ("friction curve", _curves),
    "lsm": ("line fits", _lines),
    "sje": ("single joints", _torques),
    "gte": ("paths", _paths),
}
"""By name, what a progress bar calls the study, and what yields parts and what was found."""


def run_studies(needs: Mapping[str, Sequence[Any]], how: Options, tell: Tell) -> Found:
    """Return what was found by study and part.

    Args:
        needs: parts by study.
        how: options of all.
        tell: called with what is being done, how many parts of it are, and how many there are.
    """
    found: dict[str, dict[Any, Any]] = {name: {} for name in STUDIES if name in needs}
    for name, mine in found.items():
        title, run = STUDIES[name]
        tell(title, 0, len(needs[name]))
        for part, result in run(needs[name], how):
            mine[part] = result
            tell(title, len(mine), len(needs[name]))
    return found
