"""Numbers of the policy benchmark's page, from the episodes that were measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Row
from benchmarks.learning.policies_plan import (
    BASELINES,
    CONSTANT,
    NOMINAL,
    RANDOM_PATHS,
    RULES,
    TRAINED,
    Cell,
    Contestant,
    Plan,
)
from benchmarks.learning.policies_run import Episodes, Trained, code_today
from benchmarks.learning.policies_statistics import (
    Estimate,
    improvement_with_interval,
    mean_with_interval,
    ratio_with_interval,
)

Value = Callable[[Row], float]


class Measure(NamedTuple):
    """A number of an episode."""

    label: str
    """On the page."""
    unit: str
    value: Value
    """Returns it of a row."""
    digits: int = 2
    """On the page."""
    sign: int = 1
    """−1 where more is better."""


def _over(name: str, unit: str, below: str = "") -> Value:
    return lambda row: row[f"{name}_{unit}"] / row[f"undithered_{below or name}_{unit}"]


def _column(name: str) -> Value:
    return lambda row: row[name]


_LAST = "left at the last goal"
_POSITION, _ORIENTATION = _over("position_resting", "m"), _over("orientation_resting", "rad")
_BOTH = {
    "power": Measure("power", "1", _column("power"), 3),
    "rate": Measure("torque rate", "N·m/s", _column("torque_rate"), 0),
    "return": Measure("return", "1", _column("return"), 3, -1),
}
MEASURES = {
    "gte": {
        "position": Measure("position left", "1", _over("position_left", "m")),
        "orientation": Measure("orientation left", "1", _over("orientation_left", "rad")),
        "position_at_rest": Measure(f"position {_LAST}", "1", _POSITION),
        "orientation_at_rest": Measure(f"orientation {_LAST}", "1", _ORIENTATION),
        "tracking": Measure("tracking", "1", _column("tracking_error")),
        "moving": Measure("vibration moving", "1", _over("vibration_moving", "mm", "vibration")),
        "at_rest": Measure("vibration at rest", "mm", _column("vibration_at_rest_mm"), 3),
        **_BOTH,
    },
    "sje": {
        "torque": Measure(
            "breakaway torque left", "1", lambda row: abs(row["tau_sje_nm"] / row["tau_base_nm"])
        ),
        "oscillation": Measure("oscillation", "mrad", _column("oscillation_mrad"), 3),
        **_BOTH,
    },
}
"""Of an episode, by experiment and key."""
ERRORS = ("position", "orientation")
VIBRATIONS = ("moving", "at_rest")
AIM = {"position": 0.35, "orientation": 0.40}
"""Share by which less than Table 4.9 is to be left [-]; assumed."""
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

    @property
    def unsure(self) -> list[str]:
        """What may be smaller or larger."""
        return [key for key, x in self.improvement.items() if x.low <= 0.5 <= x.high]

    @property
    def as_calm(self) -> bool:
        """Whether it shakes no more, moving and at rest."""
        prices = set(self.ratio) - set(self.improvement)
        return all(self.ratio[key].value <= 1 for key in prices)

    @property
    def beats(self) -> bool:
        """Whether all that is wanted is smaller without doubt, at no more vibration."""
        return all(x.low > 0.5 for x in self.improvement.values()) and self.as_calm

    @property
    def meets_aim(self) -> bool:
        """Whether so much less is left as is aimed at, at no more vibration."""
        return self.as_calm and all(self.ratio[k].value <= 1 - AIM[k] for k in ERRORS)


@dataclass(frozen=True, kw_only=True)
class Results:
    """All that was measured and trained."""

    episodes: Episodes
    plan: Plan
    there: Sequence[tuple[Cell, Contestant]]
    """What was measured."""
    trained: Sequence[Trained]
    best: str
    """Algorithm whose policies had the best evaluations in training."""

    @cached_property
    def by_cell(self) -> dict[Cell, dict[str, list[Contestant]]]:
        """Agents by cell and name; a name that learns has one per training."""
        out: dict[Cell, dict[str, list[Contestant]]] = {}
        for cell, one in self.there:
            out.setdefault(cell, {}).setdefault(one.name, []).append(one)
        return out

    @property
    def by_earlier_code(self) -> int:
        """Count the trainings that other code than today's made."""
        return sum(one.code != code_today() for one in self.trained)

    @property
    def learned(self) -> str:
        """Name of the best algorithm's policies."""
        return TRAINED[self.best]

    def cell(self, robot: str, task: str, friction: float = NOMINAL) -> Cell:
        """Return a cell."""
        where = (robot, task, friction)
        return next(c for c in self.by_cell if (c.robot, c.task, c.friction) == where)

    def scores(self, cell: Cell, name: str, key: str) -> NDArray[np.float64]:
        """Return a measure (runs, tasks) of an agent.

        What an episode does not have is infinitely bad; lower is better, of the return too, whose
        sign is turned.
        """
        of = MEASURES[cell.experiment][key]
        rows = [row for one in self.by_cell[cell][name] for row in self.episodes.read(cell, one)]
        values = np.array([of.sign * of.value(row) for row in rows], dtype=float)
        return np.where(np.isnan(values), np.inf, values).reshape(-1, len(cell.options))

    def estimate(self, cell: Cell, name: str, key: str) -> Estimate:
        """Return the interquartile mean of a measure as it is, with its interval."""
        found = mean_with_interval(self.scores(cell, name, key))
        if MEASURES[cell.experiment][key].sign > 0:
            return found
        return Estimate(-found.value, -found.high, -found.low)

    def truncated(self, cell: Cell, name: str) -> int:
        """Count an agent's episodes that did not come to their end."""
        agents = self.by_cell[cell][name]
        return sum(not row["terminated"] for x in agents for row in self.episodes.read(cell, x))

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
        )

    def improvements(self, cell: Cell) -> dict[str, Against]:
        """Return every agent against the robot's baseline."""
        base = BASELINES[cell.robot]
        return {x: self.against(cell, x, base) for x in self.by_cell[cell] if x != base}

    @property
    def rates(self) -> dict[str, float]:
        """Mean steps/s of trainings, by algorithm and experiment."""
        found: dict[str, list[float]] = {}
        for one in self.trained:
            t = one.training
            if one.steps_per_second is not None:
                name = f"{TRAINED[t.algorithm]} ({t.experiment.upper()})"
                found.setdefault(name, []).append(one.steps_per_second)
        return {name: float(np.mean(rates)) for name, rates in found.items()}

    @property
    def measuring_hours(self) -> float:
        """How long all episodes took [h]."""
        return sum(self.episodes.seconds(cell, one) for cell, one in self.there) / 3600

    def rivals(self, task: str = RANDOM_PATHS) -> tuple[str, str]:
        """Return the best constant table and the best rule, by return on a test of the Panda."""
        cell = self.cell("panda", task)

        def best(names: Sequence[str]) -> str:
            there = [name for name in names if name in self.by_cell[cell]]
            return max(there, key=lambda name: self.estimate(cell, name, "return").value)

        return best(CONSTANT), best(RULES)
