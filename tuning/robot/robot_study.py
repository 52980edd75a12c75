"""The study of a robot: the predictions, and every measurement that was entered.

A row is one setting of one entered table; another holds the predictions. A table that is entered
again (after a power cut, say) adds only what is missing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from stiction_envs.reporting.json_text import JsonRecord
from stiction_envs.reporting.kept_rows import KeptRows
from tuning.robot.measured_table import MeasuredRow
from tuning.robot.posterior import CONFIGURATIONS, Candidates, Readings

PREDICTIONS = "predictions"
CELL = tuple[int, str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class Predicted:
    """Candidates of every joint, and the simulated base torques."""

    candidates: Mapping[int, Candidates]
    base_nm: Mapping[CELL, float]
    """|τ_base| [N·m] of (joint, pose, direction)."""
    limit: Sequence[float]
    """(n,) largest displacement [rad]; inf for no limit."""

    def find(self, setting: tuple[int, float, float], same: float) -> int | None:
        """Return the number of a setting among its joint's, relative difference up to ``same``."""
        joint, frequency, amplitude = setting
        c = self.candidates[joint]
        apart = np.maximum(
            np.abs(c.frequency_hz / frequency - 1), np.abs(c.amplitude_nm[:, 0] / amplitude - 1)
        )
        best = int(apart.argmin())
        return best if apart[best] <= same else None


def predictions(study: KeptRows) -> Predicted | None:
    """Return the predictions of a study; None if there are none yet."""
    found = study.every.get(PREDICTIONS)
    if found is None:
        return None
    return Predicted(
        candidates={
            int(j): Candidates(joint=int(j), **{k: np.array(v) for k, v in c.items()})
            for j, c in found["joints"].items()
        },
        base_nm={(j, load, direction): tau for j, load, direction, tau in found["base"]},
        limit=found["limit"],
    )


def write_predictions(study: KeptRows, predicted: Predicted) -> None:
    """Write the predictions, which replace earlier ones; floats read back exactly."""
    row = {
        "joints": {
            str(j): {f.name: getattr(c, f.name).tolist() for f in fields(c)[1:]}
            for j, c in predicted.candidates.items()
        },
        "base": [[*cell, tau] for cell, tau in predicted.base_nm.items()],
        "limit": [*predicted.limit],
    }
    study.add(PREDICTIONS, row)


def add_measured(study: KeptRows, rows: Iterable[MeasuredRow], file: str) -> int:
    """Add a measured table, whose hash is ``file``; return the number of new settings."""
    groups: dict[tuple[int, float, float], list[MeasuredRow]] = {}
    for row in rows:
        groups.setdefault((row.joint, 0.0, 0.0) if row.is_base else row.setting, []).append(row)
    new = {f"{file} {s}": s for s in groups if f"{file} {s}" not in study.every}
    for key, setting in new.items():
        cells = [[r.load, r.direction, r.tau_nm] for r in groups[setting]]
        study.add(key, {"file": file, "setting": [*setting], "rows": cells})
    return len(new)


def measured_settings(study: KeptRows) -> list[JsonRecord]:
    """Return the rows of all measured settings, in order."""
    return [row for key, row in study.every.items() if key != PREDICTIONS]


class BaseTorques:
    """Base torques: from the same table if it has one, else from all tables, else simulated."""

    def __init__(self, study: KeptRows, simulated: Mapping[CELL, float]) -> None:
        self._simulated = simulated
        self._all: dict[CELL, list[float]] = {}
        self._file: dict[tuple[str, CELL], list[float]] = {}
        for row in measured_settings(study):
            joint, _, amplitude = row["setting"]
            for load, direction, tau in row["rows"]:
                if amplitude == 0 and math.isfinite(tau):
                    cell = (joint, load, direction)
                    self._all.setdefault(cell, []).append(abs(tau))
                    self._file.setdefault((row["file"], cell), []).append(abs(tau))

    def measured(self, cell: CELL) -> bool:
        """Return whether a base torque was measured."""
        return cell in self._all

    def base(self, cell: CELL, file: str) -> float:
        """Return |τ_base| [N·m] for a torque of a table."""
        taus = self._file.get((file, cell)) or self._all.get(cell) or [self._simulated[cell]]
        return float(np.mean(taus))


def readings(
    study: KeptRows, base: BaseTorques, predicted: Predicted, same: float
) -> dict[int, Readings]:
    """Return the measurements of every joint's settings."""
    out: dict[int, list[tuple[int, int, float]]] = {j: [] for j in predicted.candidates}
    for row in measured_settings(study):
        joint, frequency, amplitude = row["setting"]
        if amplitude == 0:
            continue
        at = predicted.find((joint, frequency, amplitude), same)
        if at is None:
            continue
        for load, direction, tau in row["rows"]:
            ratio = abs(tau) / base.base((joint, load, direction), row["file"])
            out[joint].append((at, CONFIGURATIONS.index((load, direction)), ratio))
    return {j: Readings.of(rows) for j, rows in out.items()}
