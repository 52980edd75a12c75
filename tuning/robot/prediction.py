"""Candidate settings of a robot, within its bounds, and what the simulation predicts for them.

Two passes: a grid over frequency and amplitude; then, at every frequency, the amplitude that
reaches the displacement limit, where the best setting usually lies, and none beyond the limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, Job, Measurement
from stiction_envs.measured import AmplitudeRow
from tuning.robot.candidates import CONFIGURATIONS, Candidates
from tuning.search.bounds import Bounds
from tuning.settings import RobotSettings, tuning_settings

Array = NDArray[np.float64]
TRIED = 2000
"""Frequencies checked between the bounds, to find those outside forbidden bands."""
MARGIN = 0.97
"""Share of the displacement limit that the second pass aims at, because it interpolates."""


def allowed(bounds: Bounds, row: AmplitudeRow) -> bool:
    """Return whether a setting is within all bounds of its joint."""
    low, high = bounds.frequency_hz[row.joint - 1]
    return bool(
        low <= row.frequency_hz <= high
        and max(bounds.amplitude_nm[row.joint - 1, 0], 0.0) <= row.amplitude_nm
        and 0 < row.amplitude_nm <= bounds.largest(row.joint, row.frequency_hz)
        and bounds.forbidden(row.joint, row.frequency_hz) <= 0
    )


def grid(bounds: Bounds, joint: int, settings: RobotSettings | None = None) -> list[AmplitudeRow]:
    """Return settings of a joint (from 1): frequencies even in the logarithm, amplitudes in size.

    The largest amplitude at every frequency is included, forbidden bands are left out.

    Raises:
        StictionError: the bounds allow no setting.
    """
    s = settings or tuning_settings().robot
    low, high = bounds.frequency_hz[joint - 1]
    tried = np.clip(np.geomspace(low, high, TRIED), low, high)
    free = tried[[bounds.forbidden(joint, float(f)) <= 0 for f in tried]]
    at = np.unique(np.linspace(0, len(free) - 1, s.frequencies).round().astype(int))
    rows = [
        bounds.setting(joint, {"frequency_hz": f, "amplitude": share})
        for f in (free[at] if len(free) else [])
        for share in np.arange(1, s.amplitudes + 1) / s.amplitudes
    ]
    kept = [row for row in dict.fromkeys(rows) if allowed(bounds, row)]
    if not kept:
        raise StictionError(f"bounds of joint {joint} leave no setting: expected one or more")
    return kept


def predict(
    experiment: SingleJointExperiment,
    bounds: Bounds,
    limit: Array,
    *,
    joints: Sequence[int] | None = None,
    settings: RobotSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict[int, Candidates]:
    """Return the candidates of joints with simulated ratios and displacements.

    Args:
        experiment: the arm.
        bounds: bounds of the settings.
        limit: (n,) largest displacement, root mean square over configurations [rad]; inf for none.
        joints: from 1; None for all.
        settings: numbers of the method; None for those of ``settings.toml``.
        progress: called with simulated seconds.

    Raises:
        StictionError: bounds or a limit that leave a joint without settings.
    """
    s = settings or tuning_settings().robot
    chosen = list(joints or range(1, experiment.n + 1))
    rows = [row for j in chosen for row in grid(bounds, j, s)]
    found = measure(experiment, rows, s.iterations, progress, base=chosen)
    second = [row for row in _at_limit(found, rows, limit) if allowed(bounds, row)]
    found |= measure(experiment, second, s.iterations, progress)
    out = {}
    for j in chosen:
        mine = sorted({r for r in (*rows, *second) if r.joint == j}, key=_place)
        out[j] = candidates(found, j, mine, float(limit[j - 1]))
    return out


def measure(
    experiment: SingleJointExperiment,
    rows: Sequence[AmplitudeRow],
    iterations: int,
    progress: Callable[[float], None] | None = None,
    *,
    base: Sequence[int] = (),
) -> dict[Job, Measurement]:
    """Simulate settings in their four configurations, and the base torques of joints ``base``."""
    jobs = [job(row, *c) for row in rows for c in CONFIGURATIONS]
    jobs += [Job(Configuration(j, *c)) for j in base for c in CONFIGURATIONS]
    wanted = list(dict.fromkeys(jobs))
    return {m.job: m for m in experiment.run(wanted, iterations=iterations, progress=progress)}


def job(row: AmplitudeRow, load: str, direction: str) -> Job:
    """Return the job of a setting in a configuration."""
    return Job(Configuration(row.joint, load, direction), row.frequency_hz, row.amplitude_nm)


def shaken(found: Mapping[Job, Measurement], row: AmplitudeRow) -> float:
    """Return the root mean square displacement of a setting over its configurations [rad]."""
    each = [found[job(row, *c)].displacement for c in CONFIGURATIONS]
    return float(np.sqrt(np.mean(np.square(each))))


def candidates(
    found: Mapping[Job, Measurement], joint: int, rows: Sequence[AmplitudeRow], limit: float
) -> Candidates:
    """Return the settings of a joint that free it in simulation and satisfy the limit [rad]."""
    base = [abs(found[Job(Configuration(joint, *c))].mean) for c in CONFIGURATIONS]
    table = [
        (row, [found[job(row, *c)] for c in CONFIGURATIONS])
        for row in rows
        if shaken(found, row) <= limit
    ]
    table = [(row, m) for row, m in table if all(np.isfinite(x.mean) for x in m)]
    if not table or not np.isfinite(base).all():
        raise StictionError(
            f"joint {joint}: no setting within the bounds keeps to the displacement limit of "
            f"{limit:.3g} rad and frees it in simulation: expected one or more"
        )
    return Candidates(
        joint=joint,
        frequency_hz=np.array([row.frequency_hz for row, _ in table]),
        amplitude_nm=np.array([[row.amplitude_nm] * 4 for row, _ in table]),
        predicted=np.array([[abs(x.mean) for x in m] for _, m in table]) / base,
        displacement=np.array([[x.displacement for x in m] for _, m in table]),
    )


def _place(row: AmplitudeRow) -> tuple[float, float]:
    return row.frequency_hz, row.amplitude_nm


def _at_limit(
    found: Mapping[Job, Measurement], rows: Sequence[AmplitudeRow], limit: Array
) -> list[AmplitudeRow]:
    """Return for every joint and frequency the amplitude that reaches the limit, interpolated."""
    out = []
    for joint, frequency in dict.fromkeys((r.joint, r.frequency_hz) for r in rows):
        mine = sorted(
            (r for r in rows if (r.joint, r.frequency_hz) == (joint, frequency)), key=_place
        )
        a = np.array([r.amplitude_nm for r in mine])
        x = np.maximum.accumulate([shaken(found, r) for r in mine])
        aim = MARGIN * limit[joint - 1]
        if x[-1] <= limit[joint - 1] or not x[0] > 0:
            continue
        # a joint that still sticks oscillates in proportion to the amplitude
        first = a[0] * aim / x[0]
        size = first if aim < x[0] else np.exp(np.interp(np.log(aim), np.log(x), np.log(a)))
        out.append(AmplitudeRow(joint, frequency, float(size)))
    return out
