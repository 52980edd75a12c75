"""Cells of the thesis's tables, which of them may be fitted, and how a prediction is scored."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import Configuration
from stiction_envs.measured.thesis_tables import DitheredRow, thesis_dithered

FITTED = ("4.6",)
"""Table whose dithered cells a model may use, besides the base torques of Table 4.3."""
FREQUENCIES = (80.0, 50.0, 30.0, 15.0)
"""Dither frequencies of Tables 4.6 to 4.8 [Hz]."""
RESAMPLES = 2000
"""Bootstrap resamples of the 28 configurations; assumed."""
JOINTS = range(1, 8)


@dataclass(frozen=True)
class Cell:
    """One dithered torque of the thesis."""

    row: DitheredRow

    @property
    def configuration(self) -> Configuration:
        """Joint, pose and direction."""
        return Configuration(self.row.joint, self.row.load, self.row.direction)

    @property
    def change(self) -> float:
        """Measured |τ_SJE| / |τ_base| − 1 [-]."""
        return abs(self.row.tau_sje_nm) / abs(self.row.tau_base_nm) - 1.0

    @property
    def column(self) -> str:
        """The table, with its half for 4.10."""
        r = self.row
        return r.table if r.table != "4.10" else f"4.10 {r.amplitude_set}"

    @property
    def held_out(self) -> bool:
        """Whether no model has seen it."""
        return self.row.table not in FITTED


def cells() -> list[Cell]:
    """Return all 308 dithered cells of the Panda."""
    return [Cell(row) for row in thesis_dithered("panda")]


@dataclass(frozen=True)
class Score:
    """Errors of one model over its sound held-out cells [% of the base torque]."""

    name: str
    error: NDArray[np.float64]
    """(cells,) |predicted − measured| / |τ_base|, of all cells."""
    mean: float
    low: float
    high: float
    """95 % bootstrap interval of the mean over configurations."""
    median: float
    by_column: dict[str, float]
    by_joint: dict[int, float]


def score(name: str, all_cells: list[Cell], predicted: NDArray[np.float64]) -> Score:
    """Score predicted changes (cells,) [-] of all cells."""
    error = 100 * np.abs(predicted - np.array([c.change for c in all_cells]))
    good = np.array([c.held_out and not c.row.outlier for c in all_cells])
    sound = [c for c in all_cells if c.held_out and not c.row.outlier]
    numbers = {c: k for k, c in enumerate(dict.fromkeys(c.configuration for c in sound))}
    group = [numbers[c.configuration] for c in sound]
    sums, counts = np.bincount(group, error[good]), np.bincount(group)
    picks = np.random.default_rng(0).integers(len(sums), size=(RESAMPLES, len(sums)))
    low, high = np.percentile(sums[picks].sum(axis=1) / counts[picks].sum(axis=1), [2.5, 97.5])

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
        by_joint={j: mean_of([c.row.joint == j for c in all_cells]) for j in JOINTS},
    )


def repeat_floor(all_cells: list[Cell]) -> tuple[float, float]:
    """Return (mean, median) difference of the thesis's own repeats of one setting [%]."""

    def setting(c: Cell) -> tuple[object, ...]:
        return c.configuration, c.row.frequency_hz, round(c.row.amplitude_nm, 3)

    first = {setting(c): c.change for c in all_cells if c.row.table != "4.10" and not c.row.outlier}
    repeats = [c for c in all_cells if c.column == "4.10 intermediate" and setting(c) in first]
    gaps = [100 * abs(c.change - first[setting(c)]) for c in repeats]
    return float(np.mean(gaps)), float(np.median(gaps))
