"""What nested models say, as numbers: scores, gains by joint, ranges, residuals.

The page puts these into sentences; nothing here is text for a reader.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.sje.protocol import Configuration, load_protocol
from stiction_envs.gap.tables.cells import RESAMPLES, Cell, Score, repeat_floor, score
from stiction_envs.gap.tables.model import drift_factors, with_drift
from stiction_envs.thesis.joint_theory import JointTheory
from stiction_envs.thesis.nested_models import PHYSICAL, ROBOT, NestedModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
JOINTS = range(1, 8)
FREQUENCIES = (80.0, 50.0, 30.0, 15.0)
"""Of thesis Table 4.6 [Hz]."""
ARM = "arm + drift"
TARGETS = {"mean": 3.5, "median": 2.3, "4.10 final": 4.5, "worst joint": 8.0}
"""Held-out errors aimed at [% of base torque]; broken cells apart."""
LEAST_GAIN = 0.3
"""Least change of a joint's mean error that counts, in points; a tenth of the thesis's own
repeats; assumed."""
SAME_LOSS = 2.0
"""Losses (minus log posterior) that differ by less are the same: a factor of 7 in posterior."""
SAME_RANGE = 1.25
"""Largest over smallest value over the equally good seeds, up to which a parameter counts as
identified; assumed."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """What one statement did to the mean held-out error of a joint, in % of the base torque."""

    before: float
    after: float
    low: float
    high: float
    """95 % bootstrap interval of ``before − after``, the joint's cells taken as independent."""

    @property
    def points(self) -> float:
        """Error taken away."""
        return self.before - self.after

    @property
    def better(self) -> bool:
        """Whether it is significant against the scatter of the cells, and counts."""
        return self.low > 0 and self.points >= LEAST_GAIN

    @property
    def worse(self) -> bool:
        """Whether the error grew by more than the scatter, and by what counts."""
        return self.high < 0 and self.points <= -LEAST_GAIN


@dataclass(frozen=True, kw_only=True)
class Gain:
    """One statement, for one joint."""

    key: str
    name: str
    plain: Change
    """As the models are."""
    shape: Change | None
    """With the bases free to move on both sides, so that only how the torque depends on frequency,
    amplitude and direction counts; None where a base cannot move."""

    @property
    def named(self) -> bool:
        """Whether it is a cause: better in one of the two ways, and worse in none."""
        changes = [c for c in (self.plain, self.shape) if c is not None]
        return any(c.better for c in changes) and not any(c.worse for c in changes)

    @property
    def worse(self) -> bool:
        """Whether it made the prediction worse in one way, and better in none."""
        changes = [c for c in (self.plain, self.shape) if c is not None]
        return any(c.worse for c in changes) and not any(c.better for c in changes)

    @property
    def points(self) -> float:
        """Error taken away, in the way that is significant [% of base]."""
        if self.shape is None or self.plain.better or self.plain.worse:
            return self.plain.points
        return self.shape.points if self.shape.better or self.shape.worse else self.plain.points


@dataclass(frozen=True, kw_only=True)
class Identified:
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

    ALL: ClassVar[tuple[str, ...]] = (
        *("nothing", "lookup", "band"),
        *(key for key, *_ in PHYSICAL),
        *("elasto-plastic", "arm", ARM),
    )
    """Keys of the models that the page is about; ramp rates apart."""

    def __init__(self, models: Mapping[str, NestedModel], chosen: Sequence[Cell]) -> None:
        """Score the models.

        Args:
            models: by key, any part of all there are, at least one.
            chosen: the cells they predict, in the same order.
        """
        self.models, self.cells = dict(models), list(chosen)
        self.predicted = {k: np.array(r.change, dtype=float) for k, r in self.models.items()}
        self.scores: dict[str, Score] = {
            k: score(r.name, self.cells, self.predicted[k]) for k, r in self.models.items()
        }
        self.measured = np.array([c.change for c in self.cells])
        self.sound = np.array([not c.row.outlier for c in self.cells])
        self.held_out = np.array([c.held_out for c in self.cells]) & self.sound
        self.joint = np.array([c.row.joint for c in self.cells])
        self.frequency = np.array([c.row.frequency_hz for c in self.cells])
        self.table = np.array([c.column for c in self.cells])
        self.floor = repeat_floor(self.cells)
        self._moved = {
            k: 100 * np.abs(with_drift(self.cells, p) - self.measured)
            for k, p in self.predicted.items()
            if (p > -1.0).all()
        }
        steps = [k for k in ("band", *(key for key, *_ in PHYSICAL), ARM) if k in self.models]
        self.chain = steps or list(self.models)[-1:]
        """Statements one after the other, from the bare band to the whole arm."""

    @property
    def last(self) -> str:
        """Key of the last statement there is."""
        return self.chain[-1]

    def mean(self, mask: Mask, key: str | None = None) -> float:
        """Return the mean change over sound cells, measured or a model's [%]; NaN without cells."""
        values = self.measured if key is None else self.predicted[key]
        mask = mask & self.sound
        return float(100 * values[mask].mean()) if mask.any() else float("nan")

    def at(self, joint: int, frequency: float, table: str = "4.6") -> Mask:
        """Return which cells are of a joint, a frequency [Hz] and a table's column."""
        mask = (self.joint == joint) & (self.frequency == frequency) & (self.table == table)
        return np.asarray(mask, dtype=np.bool_)

    def of(self, where: Configuration, table: str | None = None) -> Mask:
        """Return which cells are of a configuration (and a table's column)."""
        return np.array(
            [c.configuration == where and table in (None, c.column) for c in self.cells]
        )

    def error(self, key: str, mask: Mask) -> float:
        """Return the mean error of a model over sound cells of a mask [% of base]."""
        return float(self.scores[key].error[mask & self.sound].mean())

    # ---- causes ----------------------------------------------------------------------------------

    def gains(self, joint: int) -> list[Gain]:
        """Return what each statement did to a joint's held-out error, in order."""
        mask = self.held_out & (self.joint == joint)
        rng = np.random.default_rng(joint)
        pick = rng.integers(int(mask.sum()), size=(RESAMPLES, int(mask.sum())))

        def compare(a: Array, b: Array) -> Change:
            low, high = np.percentile((a - b)[pick].mean(axis=1), [2.5, 97.5])
            return Change(
                before=float(a.mean()), after=float(b.mean()), low=float(low), high=float(high)
            )

        out = []
        for before, after in zip(self.chain, self.chain[1:], strict=False):
            movable = after != "drift" and {before, after} <= set(self._moved)
            out.append(
                Gain(
                    key=after,
                    name=self.models[after].name.removeprefix("+ "),
                    plain=compare(self.scores[before].error[mask], self.scores[after].error[mask]),
                    shape=compare(self._moved[before][mask], self._moved[after][mask])
                    if movable
                    else None,
                )
            )
        return out

    def constant(self, joint: int | None = None) -> float:
        """Return the mean held-out error of a constant per configuration [% of base].

        Its median change in Table 4.6, at whatever frequency and amplitude: what physics that
        knows of both must beat.
        """
        mask = self.held_out if joint is None else self.held_out & (self.joint == joint)
        change = with_drift(self.cells, np.zeros(len(self.cells)))
        return float(100 * np.abs(change - self.measured)[mask].mean())

    def theory(self, joint: int, key: str | None = None) -> JointTheory:
        """Return a joint with the parameters of a model, of the last fitted one by default."""
        candidates = [key] if key else [*reversed(self.chain)]
        for k in candidates:
            found = self.models[k].found.get(str(joint))
            if found:
                parameters = {**self.models[k].fixed, **found[0]["parameters"]}
                return JointTheory(joint=joint, parameters=parameters)
        return JointTheory(joint=joint)

    # ---- identification --------------------------------------------------------------------------

    def identified(self, joint: int) -> list[Identified]:
        """Return every parameter of a joint with its range over the equally good seeds.

        Of the last of the models that were searched from the most seeds.
        """
        found = self._searched(joint)
        if not found:
            return []
        best = found[0]
        good = [f for f in found if f["loss"] <= best["loss"] + SAME_LOSS]
        out = []
        for name, value in best["parameters"].items():
            values = [f["parameters"][name] for f in good]
            out.append(
                Identified(
                    name=name,
                    best=float(value),
                    low=float(min(values)),
                    high=float(max(values)),
                    seeds=len(good),
                    on_bound=name in best.get("on_bound", []),
                )
            )
        return out

    def seeds(self, joint: int) -> int:
        """Return how many seeds that search of the joint had."""
        return len(self._searched(joint))

    def _searched(self, joint: int) -> list[dict[str, Any]]:
        # the whole arm is corrected from one place only
        keys = ("arm", *reversed(self.chain))
        return max((self._found(k, joint) for k in keys), key=len, default=[])

    def _found(self, key: str, joint: int) -> list[dict[str, Any]]:
        return self.models[key].found.get(str(joint), []) if key in self.models else []

    def ramp_rates(self) -> dict[float, str]:
        """Return the model of every ramp rate tried [N·m/s]; that of the protocol is ``drift``."""
        out = {float(k.removeprefix("ramp ")): k for k in self.models if k.startswith("ramp ")}
        if out and "drift" in self.models:
            out.setdefault(load_protocol(ROBOT).ramp_rate, "drift")
        return dict(sorted(out.items()))

    def preferred(self, key: str, other: str) -> tuple[float, float]:
        """Return by how much the fitted cells prefer one model to another, and how surely.

        Returns:
            Loss of ``other`` less that of ``key``, summed over the joints, and twice its standard
            error from the joints' differences: less than that is no preference.
        """
        joints = sorted(set(self.models[key].found) & set(self.models[other].found))
        gap = np.array([self._loss(other, j) - self._loss(key, j) for j in joints])
        if len(gap) < 2:
            return float(gap.sum()), float("inf")
        return float(gap.sum()), float(2 * np.sqrt(len(gap)) * gap.std(ddof=1))

    def _loss(self, key: str, joint: str) -> float:
        return float(self.models[key].found[joint][0]["loss"])

    def drift(self) -> dict[Configuration, float]:
        """Return each configuration's factor on its base, of the last statement without drift."""
        key = "arm" if "arm" in self.models else "offset"
        if key not in self.models:
            return {}
        fitted = [not c.held_out for c in self.cells]
        return drift_factors(self.cells, self.predicted[key], fitted)

    # ---- what is left ----------------------------------------------------------------------------

    def residual(self, key: str | None = None) -> Array:
        """Return (cells,) predicted − measured of a model [% of base]."""
        return 100 * (self.predicted[key or self.last] - self.measured)

    def targets(self) -> dict[str, tuple[float, float]]:
        """Return (reached, aimed at) of every target, of the last statement [% of base]."""
        s = self.scores[self.last]
        reached = {
            "mean": s.mean,
            "median": s.median,
            "4.10 final": s.by_column["4.10 final"],
            "worst joint": max(s.by_joint.values()),
        }
        return {k: (reached[k], TARGETS[k]) for k in TARGETS}

    def shares(self, joint: int) -> tuple[float, float, float]:
        """Split the held-out residual of a joint's last statement.

        Returns:
            Shares of its mean square that are constant per configuration (its base moved), common
            to all configurations at one frequency (the model's frequency response), and the rest.
        """
        mask = self.held_out & (self.joint == joint)
        r = self.residual()[mask]
        cells = [c for c, m in zip(self.cells, mask, strict=True) if m]
        total = float((r**2).sum())
        if total == 0:
            return 0.0, 0.0, 0.0
        where = _group_means(r, [c.configuration for c in cells])
        tone = _group_means(r - where, [c.row.frequency_hz for c in cells])
        rest = r - where - tone
        parts = np.array([(where**2).sum(), (tone**2).sum(), (rest**2).sum()])
        parts /= parts.sum()
        return float(parts[0]), float(parts[1]), float(parts[2])


def _group_means(values: Array, groups: Sequence[object]) -> Array:
    """Return the mean of each value's group, (values,)."""
    out = np.empty_like(values)
    for g in set(groups):
        mine = np.array([x == g for x in groups])
        out[mine] = values[mine].mean()
    return out
