"""Candidate settings of one joint, what the simulation predicts for them, and what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import DIRECTIONS, LOADS

Array = NDArray[np.float64]
Index = NDArray[np.int64]
CONFIGURATIONS = tuple((load, direction) for load in LOADS for direction in DIRECTIONS)
"""Pose and direction of a joint, in the order of every axis of length four."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidates:
    """S settings of one joint; a setting is tried in four configurations (`CONFIGURATIONS`)."""

    joint: int
    """Number of the joint, from 1."""
    frequency_hz: Array
    """(S,) frequency [Hz]."""
    amplitude_nm: Array
    """(S, 4) amplitude in each configuration [N·m]; the thesis scales it with the base torques of
    each, an amplitude table has one for all four."""
    predicted: Array
    """(S, 4) simulated |τ|/|τ_base|: the prior mean [-]."""
    displacement: Array
    """(S, 4) simulated root mean square oscillation before breakaway [rad]."""
    deviation: Array
    """(K, S, 4) by how much the predictions under each of K frictions differ from their mean, which
    is ``predicted`` [-]."""
    eligible: NDArray[np.bool_]
    """(S,) may be proposed and chosen; the others (too much vibration) only serve for learning."""

    def __len__(self) -> int:
        return len(self.frequency_hz)

    @cached_property
    def features(self) -> Array:
        """(4 S, 4) inputs of `posterior.discrepancy_kernel`.

        Cells are in the order of ``predicted.ravel()``. Columns: ln f, ln of the displacement,
        configuration 0…3, setting 0…S−1.
        """
        setting, configuration = np.indices(self.predicted.shape)
        frequency = np.log(self.frequency_hz)[setting]
        columns = (frequency, np.log(self.displacement), configuration, setting)
        return np.stack([x.ravel() for x in columns], axis=1).astype(float)


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """M measured cells of one joint; a cell may occur several times."""

    setting: Index
    """(M,) from 0."""
    configuration: Index
    """(M,) 0…3."""
    ratio: Array
    """(M,) |τ|/|τ_base| [-]; NaN: the joint stuck, or the run failed."""

    @classmethod
    def of(cls, rows: Sequence[tuple[int, int, float]]) -> Readings:
        """Return readings from (setting, configuration, ratio)."""
        return cls(
            setting=np.array([r[0] for r in rows], dtype=np.int64),
            configuration=np.array([r[1] for r in rows], dtype=np.int64),
            ratio=np.array([r[2] for r in rows], dtype=float),
        )

    def __len__(self) -> int:
        return len(self.ratio)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(M,) whether there is a number."""
        return np.isfinite(self.ratio)

    def with_rows(self, rows: Sequence[tuple[int, int, float]]) -> Readings:
        """Return these readings with more rows."""
        mine = zip(self.setting, self.configuration, self.ratio, strict=True)
        return Readings.of([*((int(s), int(c), float(r)) for s, c, r in mine), *rows])

    def done(self, settings: int) -> NDArray[np.bool_]:
        """Return (S, 4) whether each cell was tried, measured or failed."""
        out = np.zeros((settings, 4), dtype=bool)
        out[self.setting, self.configuration] = True
        return out

    def failed(self, settings: int) -> NDArray[np.bool_]:
        """Return (S,) whether a setting has a cell that was tried and never gave a number."""
        valid = np.zeros((settings, 4), dtype=bool)
        valid[self.setting[self.valid], self.configuration[self.valid]] = True
        return np.asarray((self.done(settings) & ~valid).any(axis=1))

    def measured(self, settings: int) -> NDArray[np.bool_]:
        """Return (S,) whether a setting has a number in all four configurations."""
        return np.asarray(self.done(settings).all(axis=1) & ~self.failed(settings))
