"""Cells of the thesis's tables, which of them may be fitted, and how a prediction is scored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.gap.tables.readings import Cell as MeasuredCell
from stiction_envs.measured import thesis_dithered

FITTED = ("4.6",)
"""Table whose dithered cells a rung may use, besides the base torques of Table 4.3."""
RESAMPLES = 2000
"""Bootstrap resamples of the 28 configurations."""


class Cell(MeasuredCell):
    """One dithered torque of the thesis."""

    @property
    def column(self) -> str:
        """The table, with its half for 4.10."""
        r = self.row
        return r.table if r.table != "4.10" else f"4.10 {r.amplitude_set}"

    @property
    def held_out(self) -> bool:
        """Whether no rung has seen it."""
        return self.row.table not in FITTED


def cells() -> list[Cell]:
    """Return all 308 dithered cells of the Panda."""
    return [Cell(row) for row in thesis_dithered("panda")]


@dataclass(frozen=True)
class Score:
    """Errors of one rung, in per cent of the base torque."""

    name: str
    error: np.ndarray
    """(cells,) |predicted − measured| / |τ_base| [%]."""
    mean: float
    low: float
    high: float
    """Mean over the held-out cells and its 95 % bootstrap interval over configurations [%]."""
    median: float
    by_column: dict[str, float]
    by_joint: dict[int, float]
    broken: list[tuple[Cell, float]]
    """Cells known to be broken, scored apart."""


def score(name: str, all_cells: list[Cell], predicted: np.ndarray) -> Score:
    """Score predicted changes (cells,) [-] of all cells."""
    measured = np.array([c.change for c in all_cells])
    error = 100 * np.abs(np.asarray(predicted) - measured)
    good = np.array([c.held_out and not c.row.outlier for c in all_cells])
    groups: dict[Configuration, list[float]] = {}
    for c, e, ok in zip(all_cells, error, good, strict=True):
        if ok:
            groups.setdefault(c.configuration, []).append(float(e))
    lists = list(groups.values())
    rng = np.random.default_rng(0)
    picks = rng.integers(len(lists), size=(RESAMPLES, len(lists)))
    sums, counts = np.array([sum(x) for x in lists]), np.array([len(x) for x in lists])
    means = sums[picks].sum(axis=1) / counts[picks].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])

    def mean_of(chosen: list[bool]) -> float:
        return float(error[np.array(chosen) & good].mean())

    columns = dict.fromkeys(c.column for c in all_cells if c.held_out)
    return Score(
        name=name,
        error=error,
        mean=float(error[good].mean()),
        low=float(low),
        high=float(high),
        median=float(np.median(error[good])),
        by_column={k: mean_of([c.column == k for c in all_cells]) for k in columns},
        by_joint={j: mean_of([c.row.joint == j for c in all_cells]) for j in range(1, 8)},
        broken=[(c, float(e)) for c, e in zip(all_cells, error, strict=True) if c.row.outlier],
    )


def repeat_floor(all_cells: list[Cell]) -> tuple[float, float]:
    """Return (mean, median) difference of the thesis's own repeats of one setting [%]."""
    first = {
        (c.configuration, c.row.frequency_hz, round(c.row.amplitude_nm, 3)): c.change
        for c in all_cells
        if c.row.table != "4.10" and not c.row.outlier
    }
    gaps = [
        100 * abs(c.change - first[key])
        for c in all_cells
        if c.column == "4.10 intermediate"
        and (key := (c.configuration, c.row.frequency_hz, round(c.row.amplitude_nm, 3))) in first
    ]
    return float(np.mean(gaps)), float(np.median(gaps))
