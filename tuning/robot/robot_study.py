"""The study of a robot: the predictions, and every measurement that was entered.

A trial is one setting of one entered table, with its rows; a study attribute holds the predictions.
A table that is entered again (after a power cut, say) adds only what is missing.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
import optuna
from optuna.distributions import FloatDistribution, IntDistribution
from optuna.trial import TrialState

from stiction_envs.reporting.json_text import JsonRecord
from tuning.robot.measured_table import MeasuredRow
from tuning.robot.posterior import CONFIGURATIONS, Candidates, Readings
from tuning.study.record import Record
from tuning.study.storage import writing

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

    def to_json(self) -> dict[str, object]:
        """Return JSON values; floats read back exactly."""
        return {
            "joints": {
                str(j): {f.name: getattr(c, f.name).tolist() for f in fields(c)[1:]}
                for j, c in self.candidates.items()
            },
            "base": [[*cell, tau] for cell, tau in self.base_nm.items()],
            "limit": [None if math.isinf(x) else x for x in self.limit],
        }

    @classmethod
    def of_json(cls, found: JsonRecord) -> Predicted:
        """Read the result of `to_json`."""
        return cls(
            candidates={
                int(j): Candidates(joint=int(j), **{k: np.array(v) for k, v in c.items()})
                for j, c in found["joints"].items()
            },
            base_nm={(j, load, direction): tau for j, load, direction, tau in found["base"]},
            limit=[math.inf if x is None else x for x in found["limit"]],
        )


def predictions(record: Record) -> Predicted | None:
    """Return the predictions of a study; None if there are none yet."""
    text = record.study.user_attrs.get(PREDICTIONS)
    return None if text is None else Predicted.of_json(json.loads(text))


def write_predictions(record: Record, predicted: Predicted) -> None:
    """Write the predictions, replacing earlier ones."""
    with writing(record.place):
        record.study.set_user_attr(PREDICTIONS, json.dumps(predicted.to_json()))


def add_measured(
    record: Record, rows: Sequence[MeasuredRow], file: str, most: float, n: int
) -> int:
    """Add a measured table, a trial per setting; return the number of new trials.

    ``file`` is the table's hash, ``most`` the largest possible frequency [Hz] or amplitude [N·m],
    ``n`` the number of joints.
    """
    known = {(t["file"], tuple(t["setting"])) for t in measured_trials(record)}
    groups: dict[tuple[int, float, float], list[MeasuredRow]] = {}
    for row in rows:
        setting = (row.joint, 0.0, 0.0) if row.is_base else row.setting
        groups.setdefault(setting, []).append(row)
    new = {s: group for s, group in groups.items() if (file, s) not in known}
    ratio = BaseTorques(record, rows)
    for (joint, frequency, amplitude), group in new.items():
        cells = [
            [r.load, r.direction, r.tau_nm if math.isfinite(r.tau_nm) else None] for r in group
        ]
        value = ratio.mean(group)
        record.add(
            optuna.trial.create_trial(
                state=TrialState.FAIL if value is None else TrialState.COMPLETE,
                value=value,
                params={"joint": joint, "frequency_hz": frequency, "amplitude_nm": amplitude},
                distributions={
                    "joint": IntDistribution(1, n),
                    "frequency_hz": FloatDistribution(0.0, most),
                    "amplitude_nm": FloatDistribution(0.0, most),
                },
                user_attrs={
                    "file": file,
                    "setting": [joint, frequency, amplitude],
                    "rows": cells,
                },
            )
        )
    return len(new)


def measured_trials(record: Record) -> list[JsonRecord]:
    """Return the attributes of all measured trials, in order."""
    trials = record.study.get_trials(deepcopy=False)
    return [t.user_attrs for t in trials if "rows" in t.user_attrs]


class BaseTorques:
    """Base torques: from the same table if it has one, else from all tables, else simulated."""

    def __init__(self, record: Record, rows: Sequence[MeasuredRow] = ()) -> None:
        predicted = predictions(record)
        self._simulated = {} if predicted is None else predicted.base_nm
        self._all: dict[CELL, list[float]] = {}
        self._file: dict[tuple[str, CELL], list[float]] = {}
        for t in measured_trials(record):
            joint, _, amplitude = t["setting"]
            for load, direction, tau in t["rows"]:
                if amplitude == 0 and tau is not None:
                    self._add(t["file"], (joint, load, direction), tau)
        for row in rows:
            if row.is_base and math.isfinite(row.tau_nm):
                self._add("", row.cell, row.tau_nm)

    def _add(self, file: str, cell: CELL, tau: float) -> None:
        self._all.setdefault(cell, []).append(abs(tau))
        self._file.setdefault((file, cell), []).append(abs(tau))

    def measured(self, cell: CELL) -> bool:
        """Return whether a base torque was measured."""
        return cell in self._all

    def base(self, cell: CELL, file: str = "") -> float:
        """Return |τ_base| [N·m] for a torque of a table."""
        taus = self._file.get((file, cell)) or self._all.get(cell) or [self._simulated[cell]]
        return float(np.mean(taus))

    def mean(self, rows: Sequence[MeasuredRow]) -> float | None:
        """Return the mean |τ|/|τ_base| of rows that have a torque; None if none has."""
        ratios = [abs(r.tau_nm) / self.base(r.cell) for r in rows if math.isfinite(r.tau_nm)]
        return float(np.mean(ratios)) if ratios else None


def readings(record: Record, predicted: Predicted, same: float) -> dict[int, Readings]:
    """Return the measurements of every joint's settings."""
    base = BaseTorques(record)
    out: dict[int, list[tuple[int, int, float]]] = {j: [] for j in predicted.candidates}
    for t in measured_trials(record):
        joint, frequency, amplitude = t["setting"]
        if amplitude == 0:
            continue
        at = predicted.find((joint, frequency, amplitude), same)
        if at is None:
            continue
        for load, direction, tau in t["rows"]:
            configuration = CONFIGURATIONS.index((load, direction))
            ratio = math.nan
            if tau is not None:
                ratio = abs(tau) / base.base((joint, load, direction), t["file"])
            out[joint].append((at, configuration, ratio))
    return {j: Readings.of(rows) for j, rows in out.items()}
