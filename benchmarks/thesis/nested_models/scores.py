"""What nested models say, as numbers: errors, gains by joint, ranges of parameters, residuals."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.thesis.nested_models.cells import RESAMPLES, Cell, repeat_floor, score
from benchmarks.thesis.nested_models.fit import PHYSICAL, drift_factors, with_drift
from benchmarks.thesis.nested_models.models import NestedModel
from stiction_envs.experiments.sje.protocol import Configuration

Array = NDArray[np.float64]
ARM = "arm + drift"
LEAST_GAIN = 0.3
"""Least change of a joint's mean error that counts [points of the base torque]: a tenth of the
thesis's own repeats; assumed."""
SAME_LOSS = 2.0
"""Losses (minus log posterior) that differ by less are the same: a factor of 7 in posterior;
assumed."""
SAME_RANGE = 1.25
"""Largest over smallest value over the equally good seeds [-], up to which a parameter counts as
identified; assumed."""


class Change(NamedTuple):
    """What one statement took off the mean held-out error of a joint [% of the base torque]."""

    points: float
    low: float
    high: float
    """95 % bootstrap interval, the joint's cells taken as independent."""

    @property
    def better(self) -> bool:
        """Whether it is significant against the scatter of the cells, and counts."""
        return self.low > 0 and self.points >= LEAST_GAIN

    @property
    def worse(self) -> bool:
        """Whether the error grew by more than the scatter, and by what counts."""
        return self.high < 0 and self.points <= -LEAST_GAIN


class Gain(NamedTuple):
    """One statement, for one joint: as predicted, or with the bases free to move before and after.

    With free bases only counts how the torque depends on frequency, amplitude and direction.
    """

    key: str
    shown: Change
    """The change that is significant, else that as predicted."""
    free: bool
    """Whether it is that with free bases."""
    named: bool
    """Whether it is a cause: better in one of the two ways, and worse in none."""
    worse: bool
    """Whether it made the prediction worse in one way, and better in none."""


class Identified(NamedTuple):
    """One parameter of one joint over the seeds of the search."""

    name: str
    best: float
    low: float
    high: float
    """Range over the seeds whose loss is within `SAME_LOSS` of the best."""
    seeds: int
    """How many those are."""
    on_bound: bool

    @property
    def verdict(self) -> str:
        """``yes``, ``no`` or ``cannot tell`` (one seed only)."""
        if self.on_bound or self.high > SAME_RANGE * self.low:
            return "no"
        return "yes" if self.seeds > 1 else "cannot tell"


class ModelScores:
    """Models and cells, ready to be asked."""

    CHAIN = ("band", *(key for key, *_ in PHYSICAL), ARM)
    """Statements one after the other, from the bare band to the whole arm."""

    def __init__(self, models: Mapping[str, NestedModel], chosen: Sequence[Cell]) -> None:
        """Score the models.

        Args:
            models: by key, all of them.
            chosen: the cells they predict, in the same order.
        """
        self.models, self.cells = dict(models), list(chosen)
        self.predicted = {k: np.array(r.change, dtype=float) for k, r in self.models.items()}
        self.scores = {
            k: score(r.name, self.cells, self.predicted[k]) for k, r in self.models.items()
        }
        self.measured = np.array([c.change for c in self.cells])
        self.sound = np.array([not c.row.outlier for c in self.cells])
        self.held_out = np.array([c.held_out for c in self.cells]) & self.sound
        self.joint = np.array([c.row.joint for c in self.cells])
        self.frequency = np.array([c.row.frequency_hz for c in self.cells])
        self.floor = repeat_floor(self.cells)
        self._free_base = {
            k: 100 * np.abs(with_drift(self.cells, p) - self.measured)
            for k, p in self.predicted.items()
            if (p > -1.0).all()
        }

    def at(self, joint: int, frequency: float, key: str | None = None) -> float:
        """Return the mean change in Table 4.6 at a frequency [Hz], measured or a model's [%]."""
        table = np.array([c.column == "4.6" for c in self.cells])
        mask = table & self.sound & (self.joint == joint) & (self.frequency == frequency)
        values = self.measured if key is None else self.predicted[key]
        return float(100 * values[mask].mean())

    # ---- causes ----------------------------------------------------------------------------------

    def gains(self, joint: int) -> list[Gain]:
        """Return what each statement did to a joint's held-out error, in order."""
        mask = self.held_out & (self.joint == joint)
        rng = np.random.default_rng(joint)
        pick = rng.integers(int(mask.sum()), size=(RESAMPLES, int(mask.sum())))

        def compare(errors: Mapping[str, Array], before: str, after: str) -> Change:
            a, b = errors[before][mask], errors[after][mask]
            low, high = np.percentile((a - b)[pick].mean(axis=1), [2.5, 97.5])
            return Change(float(a.mean()) - float(b.mean()), float(low), float(high))

        errors = {k: s.error for k, s in self.scores.items()}
        out = []
        for before, after in zip(self.CHAIN, self.CHAIN[1:], strict=False):
            movable = after != "drift" and {before, after} <= set(self._free_base)
            ways = [errors, self._free_base] if movable else [errors]
            changes = [compare(way, before, after) for way in ways]
            better, worse = (
                any(x) for x in zip(*((c.better, c.worse) for c in changes), strict=True)
            )
            shown = next((c for c in changes if c.better or c.worse), changes[0])
            mine = shown is not changes[0], better and not worse, worse and not better
            out.append(Gain(after, shown, *mine))
        return out

    def constant(self, joint: int) -> float:
        """Return the mean held-out error of a constant per configuration [% of base].

        The constant is the configuration's median change in Table 4.6, at all frequencies and
        amplitudes. Physics must have a smaller error.
        """
        change = with_drift(self.cells, np.zeros(len(self.cells)))
        mask = self.held_out & (self.joint == joint)
        return float(100 * np.abs(change - self.measured)[mask].mean())

    # ---- identification --------------------------------------------------------------------------

    def identified(self, joint: int) -> tuple[list[Identified], int]:
        """Return the parameters of a joint over the equally good seeds, and how many seeds ran.

        The parameters are of the lone joint with drift, the model searched from several seeds.
        """
        found = self.models["drift"].found[str(joint)]
        good = [f for f in found if f["loss"] <= found[0]["loss"] + SAME_LOSS]
        out = []
        for name, value in found[0]["parameters"].items():
            values = [f["parameters"][name] for f in good]
            on_bound = name in found[0].get("on_bound", [])
            out.append(Identified(name, value, min(values), max(values), len(good), on_bound))
        return out, len(found)

    def drift(self) -> dict[Configuration, float]:
        """Return each configuration's factor on its base, of the whole arm without drift."""
        return drift_factors(self.cells, self.predicted["arm"])
