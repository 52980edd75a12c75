"""Numbers of the policy benchmark's page: what its rows say, and what they do not say yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchmarks._policies_measures import MEASURES, truncated
from benchmarks._policies_plan import (
    BASELINES,
    CONSTANT,
    NOMINAL,
    RANDOM_PATHS,
    RULES,
    TRAINED,
    Cell,
    Contestant,
    Plan,
    episodes_in_all,
    trainings,
)
from benchmarks._policies_rows import Rows
from benchmarks._policies_statistics import (
    Estimate,
    improvement_with_interval,
    mean_with_interval,
    ratio_with_interval,
)
from benchmarks._policies_training import TOGETHER, Folder, code_today

ERRORS = ("position", "orientation")
VIBRATIONS = ("moving", "at_rest")
AIM = {"position": 0.35, "orientation": 0.40}
"""By how much less than Table 4.9 is to be left."""
WANTED = {"gte": ERRORS, "sje": ("torque",)}
"""Measures that are to be smaller, by experiment."""
PRICES = {"gte": VIBRATIONS, "sje": ("oscillation",)}
"""Measures that may not be larger for it."""


@dataclass(frozen=True, kw_only=True)
class Against:
    """One agent against another, on the same episodes."""

    ours: str
    theirs: str
    ratio: dict[str, Estimate]
    """Interquartile mean over theirs, of what is wanted and its prices."""
    improvement: dict[str, Estimate]
    """Probability of improvement, of what is wanted."""
    experiment: str = "gte"
    """``gte`` or ``sje``."""

    @property
    def wanted(self) -> tuple[str, ...]:
        """Return the measures that are to be smaller."""
        return WANTED[self.experiment]

    @property
    def prices(self) -> tuple[str, ...]:
        """Return the measures that may not be larger for it."""
        return PRICES[self.experiment]

    def less(self, key: str) -> float:
        """Return by how much less is left [%]."""
        return 100 * (1 - self.ratio[key].value)

    @property
    def better_in(self) -> list[str]:
        """Return what is smaller, without doubt."""
        return [key for key in self.wanted if self.improvement[key].low > 0.5]

    @property
    def worse_in(self) -> list[str]:
        """Return what is larger, without doubt."""
        return [key for key in self.wanted if self.improvement[key].high < 0.5]

    @property
    def as_calm(self) -> bool:
        """Whether it shakes no more, moving and at rest."""
        return all(self.ratio[key].value <= 1 for key in self.prices)

    @property
    def beats(self) -> bool:
        """Whether all that is wanted is smaller without doubt, at no more vibration."""
        return len(self.better_in) == len(self.wanted) and self.as_calm

    @property
    def meets_aim(self) -> bool:
        """Whether so much less is left as is aimed at, at no more vibration."""
        return self.as_calm and self.small_enough

    @property
    def small_enough(self) -> bool:
        """Whether so much less is left, whatever shakes."""
        return all(self.ratio[k].value <= 1 - AIM[k] for k in ERRORS)


@dataclass(frozen=True, kw_only=True)
class Results:
    """All that is there."""

    rows: Rows
    plan: Plan
    there: Sequence[tuple[Cell, Contestant]]
    """What was measured."""
    folders: Sequence[Folder]
    """Of the trainings that are over."""
    best: str | None
    """Algorithm whose policies had the best evaluations in training; None while it is not known."""
    in_all: Sequence[tuple[Cell, Contestant]]
    """What is to be measured of the agents that learn nothing."""

    @cached_property
    def by_cell(self) -> dict[Cell, dict[str, list[Contestant]]]:
        """Agents by cell and name; a name that learns has one per training."""
        out: dict[Cell, dict[str, list[Contestant]]] = {}
        for cell, one in self.there:
            out.setdefault(cell, {}).setdefault(one.name, []).append(one)
        return out

    @property
    def missing(self) -> int:
        """Count what is still to be measured of the agents that learn nothing."""
        return sum(not self.rows.there(c, a) for c, a in self.in_all)

    @property
    def by_earlier_code(self) -> int:
        """Count the finished trainings that other code than today's made."""
        return sum(one.found["code"] != code_today() for one in self.folders)

    @property
    def learned(self) -> str | None:
        """Name of the best algorithm's policies, once all that compete for it are trained."""
        return None if self.best is None else TRAINED[self.best]

    # ---- numbers -----------------------------------------------------------------------------

    def cell(self, robot: str, task: str, friction: float = NOMINAL) -> Cell | None:
        """Return a cell of which something was measured."""
        for cell in self.by_cell:
            if (cell.robot, cell.task, cell.friction) == (robot, task, friction):
                return cell
        return None

    def scores(self, cell: Cell, name: str, key: str) -> NDArray[np.float64]:
        """Return a measure (runs, tasks) of an agent; lower is better."""
        return self.rows.scores(cell, self.by_cell[cell][name], key)

    def estimate(self, cell: Cell, name: str, key: str) -> Estimate:
        """Return the interquartile mean of a measure as it is, with its interval."""
        found = mean_with_interval(self.scores(cell, name, key))
        if MEASURES[cell.experiment][key].sign > 0:
            return found
        return Estimate(-found.value, -found.high, -found.low)

    def truncated(self, cell: Cell, name: str) -> int:
        """Count an agent's episodes that did not come to their end."""
        return sum(truncated(self.rows.read(cell, one)) for one in self.by_cell[cell][name])

    def against(self, cell: Cell, ours: str, theirs: str) -> Against:
        """Compare two agents."""

        def both(key: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            return self.scores(cell, ours, key), self.scores(cell, theirs, key)

        wanted, prices = WANTED[cell.experiment], PRICES[cell.experiment]
        return Against(
            ours=ours,
            theirs=theirs,
            ratio={key: ratio_with_interval(*both(key)) for key in (*wanted, *prices)},
            improvement={key: improvement_with_interval(*both(key)) for key in wanted},
            experiment=cell.experiment,
        )

    def improvements(self, cell: Cell) -> dict[str, Against]:
        """Return every agent against the robot's baseline."""
        base = BASELINES[cell.robot]
        there = self.by_cell[cell]
        if base not in there:
            return {}
        return {name: self.against(cell, name, base) for name in there if name != base}

    def best_of(self, cell: Cell, names: Sequence[str]) -> str | None:
        """Return whose return is the largest."""
        there = [name for name in names if name in self.by_cell[cell]]
        return max(there, key=lambda n: self.estimate(cell, n, "return").value, default=None)

    def rise(self, algorithm: str, share: float) -> float | None:
        """Return by how much the mean evaluation on the Panda's paths rose in the last share."""
        curves = [
            one.curve()
            for one in self.folders
            if (one.training.robot, one.training.experiment) == ("panda", "gte")
            and one.training.algorithm == algorithm
        ]
        if not curves:
            return None
        steps = curves[0][0]  # of one plan: all evaluate at the same steps
        mean = np.mean([returns[: len(steps)] for _, returns in curves], axis=0)
        late = steps >= (1 - share) * steps[-1]
        slope = np.polyfit(steps[late], mean[late], 1)[0]
        return float(slope * share * steps[-1])

    # ---- time --------------------------------------------------------------------------------

    @cached_property
    def rates(self) -> dict[tuple[str, str], float]:
        """Mean steps/s of finished trainings, by experiment and algorithm."""
        found: dict[tuple[str, str], list[float]] = {}
        for one in self.folders:
            if (rate := one.found["steps_per_second"]) is not None:
                of = one.training.experiment, one.training.algorithm
                found.setdefault(of, []).append(rate)
        return {of: float(np.mean(rates)) for of, rates in found.items()}

    @property
    def training_hours(self) -> float | None:
        """How long all trainings take; None while one of each kind has not been finished [h]."""
        kinds = [(t.experiment, t.algorithm) for t in trainings(self.plan, self.best)]
        if self.best is None or not set(kinds) <= set(self.rates):
            return None
        return sum(self.plan.steps / self.rates[kind] for kind in kinds) / TOGETHER / 3600

    @property
    def measuring_hours(self) -> float | None:
        """How long all episodes take, as those that were measured; None while none was [h]."""
        count = sum(self.rows.episodes(cell, one) for cell, one in self.there)
        seconds = sum(self.rows.seconds(cell, one) for cell, one in self.there)
        return seconds / count * episodes_in_all(self.plan) / 3600 if count else None

    # ---- the answer --------------------------------------------------------------------------

    def rivals(self, task: str = RANDOM_PATHS) -> tuple[str, str] | None:
        """Return the best constant table and the best rule, by return on a test of the Panda."""
        cell = self.cell("panda", task)
        if cell is None:
            return None
        constant, rule = self.best_of(cell, CONSTANT), self.best_of(cell, RULES)
        return None if constant is None or rule is None else (constant, rule)

    def duels(self, ours: str, theirs: str, task: str = RANDOM_PATHS) -> dict[float, Against]:
        """Compare two agents on a test of the Panda, by friction."""
        out = {}
        for friction in self.plan.frictions:
            cell = self.cell("panda", task, friction)
            if cell is not None and {ours, theirs} <= set(self.by_cell[cell]):
                out[friction] = self.against(cell, ours, theirs)
        return out
