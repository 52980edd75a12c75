"""Candidate settings of a robot, within its bounds, and what the simulation predicts for them.

Two passes: a grid over frequency and amplitude; then, at every frequency, the amplitude that
reaches the displacement limit, where the best setting usually lies, and none beyond the limit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.reporting.kept_rows import KeptRows
from tuning.robot.posterior import Candidates
from tuning.search.bounds import TRIED, Bounds
from tuning.search.breakaway import Breakaway, BreakawayObjective
from tuning.settings import RobotSettings

MARGIN = 0.97
"""Share of the displacement limit that the second pass aims at [-], because it interpolates
(assumed)."""
PREDICTIONS = "predictions"
"""Key of the predictions in a robot's study; each other row is an entered table."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Predicted:
    """Candidates of every joint, and the simulated base torques."""

    candidates: Mapping[int, Candidates]
    base_nm: Mapping[Configuration, float]  # |τ_base| [N·m]
    limit: Sequence[float]  # (n,) largest displacement [rad]; inf for no limit

    def find(self, row: AmplitudeRow, same: float) -> int | None:
        """Return the number of a setting among its joint's, relative difference up to ``same``."""
        c = self.candidates[row.joint]
        apart = np.maximum(
            np.abs(c.frequency_hz / row.frequency_hz - 1),
            np.abs(c.amplitude_nm / row.amplitude_nm - 1),
        )
        best = int(apart.argmin())
        return best if apart[best] <= same else None

    @classmethod
    def read(cls, study: KeptRows) -> "Predicted | None":
        """Return the predictions of a study; None if there are none yet."""
        if (found := study.every.get(PREDICTIONS)) is None:
            return None
        return cls(
            candidates={
                int(j): Candidates(joint=int(j), **{k: np.array(v) for k, v in c.items()})
                for j, c in found["joints"].items()
            },
            base_nm={Configuration(*place): tau for *place, tau in found["base"]},
            limit=found["limit"],
        )

    def write(self, study: KeptRows) -> None:
        """Write the predictions, which replace earlier ones; floats read back exactly."""
        row = {
            "joints": {
                str(j): {f.name: getattr(c, f.name).tolist() for f in fields(c)[1:]}
                for j, c in self.candidates.items()
            },
            "base": [[*astuple(c), tau] for c, tau in self.base_nm.items()],
            "limit": [*self.limit],
        }
        study.add(PREDICTIONS, row)


def grid(bounds: Bounds, joint: int, settings: RobotSettings) -> list[AmplitudeRow]:
    """Return settings of a joint (from 1): frequencies even in the logarithm, amplitudes in size.

    The largest amplitude at every frequency is included, forbidden bands are left out.

    Raises:
        StictionError: the bounds allow no setting.
    """
    low, high = bounds.frequency_hz[joint - 1]
    tried = np.clip(np.geomspace(low, high, TRIED), low, high)
    free = tried[[not bounds.forbidden(joint, float(f)) for f in tried]]
    at = np.unique(np.linspace(0, len(free) - 1, settings.frequencies).round().astype(int))
    rows = [
        bounds.setting(joint, {"frequency_hz": f, "amplitude": share})
        for f in (free[at] if len(free) else [])
        for share in np.arange(1, settings.amplitudes + 1) / settings.amplitudes
    ]
    kept = [row for row in dict.fromkeys(rows) if bounds.beyond(row) is None]
    if not kept:
        raise StictionError(f"bounds of joint {joint} leave no setting: expected one or more")
    return kept


def predict(objective: BreakawayObjective, settings: RobotSettings) -> dict[int, Candidates]:
    """Return the candidates of all joints with simulated ratios and displacements.

    Raises:
        StictionError: bounds or a limit that leave a joint without settings.
    """
    bounds, limit = objective.bounds, objective.displacement
    joints = range(1, bounds.n + 1)
    rows = [row for j in joints for row in grid(bounds, j, settings)]
    found = objective.measure(rows)
    found |= objective.measure([r for r in _at_limit(found, limit) if bounds.beyond(r) is None])
    out = {}
    for j in joints:
        kept = {
            r: m
            for r, m in found.items()
            if r.joint == j and m.displacement <= limit[j - 1] and np.isfinite(m.ratio).all()
        }
        if not kept:
            raise StictionError(
                f"joint {j}: no setting within the bounds keeps to the displacement limit of "
                f"{limit[j - 1]:.3g} rad and frees it in simulation: expected one or more"
            )
        out[j] = candidates_of(j, {r: kept[r] for r in sorted(kept, key=astuple)}, limit[j - 1])
    return out


def candidates_of(joint: int, found: Mapping[AmplitudeRow, Breakaway], limit: float) -> Candidates:
    """Return measured settings of a joint as candidates; eligible within the displacement limit.

    A setting that leaves the joint stuck in simulation is predicted to have no effect.
    """
    ratio = np.nan_to_num(np.stack([m.ratio for m in found.values()], axis=1), nan=1.0)
    predicted = ratio.mean(axis=0)
    shaken = np.stack([m.oscillation.mean(axis=0) for m in found.values()])
    return Candidates(
        joint=joint,
        frequency_hz=np.array([row.frequency_hz for row in found]),
        amplitude_nm=np.array([row.amplitude_nm for row in found]),
        predicted=predicted,
        deviation=ratio - predicted,
        eligible=np.array([m.displacement <= limit for m in found.values()]),
        # at least 1e-9 rad (assumed): its logarithm is an input of the posterior
        displacement=np.maximum(shaken, 1e-9),
    )


def _at_limit(found: Mapping[AmplitudeRow, Breakaway], limit: Array) -> list[AmplitudeRow]:
    """Return for every joint and frequency the amplitude that reaches the limit, interpolated."""
    out = []
    for joint, frequency in dict.fromkeys((r.joint, r.frequency_hz) for r in found):
        mine = [r for r in found if (r.joint, r.frequency_hz) == (joint, frequency)]
        mine.sort(key=astuple)
        a = np.array([r.amplitude_nm for r in mine])
        x = np.maximum.accumulate([found[r].displacement for r in mine])
        aim = MARGIN * limit[joint - 1]
        if x[-1] <= limit[joint - 1] or not x[0] > 0:
            continue
        # a joint that still sticks oscillates in proportion to the amplitude
        first = a[0] * aim / x[0]
        size = first if aim < x[0] else np.exp(np.interp(np.log(aim), np.log(x), np.log(a)))
        out.append(AmplitudeRow(joint, frequency, float(size)))
    return out
