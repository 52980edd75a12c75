"""Nested models: the thesis's dithered torques against one physical statement after the other.

Every model is fitted to Tables 4.3 and 4.6 only and scored on 4.7, 4.8 and 4.10. Models are written
down as they are done, so that an interrupted run goes on where it was.
"""

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Rows
from benchmarks.thesis.nested_models.cells import Cell, cells
from benchmarks.thesis.nested_models.fit import (
    ALL,
    PHYSICAL,
    ROBOT,
    Found,
    JointFit,
    search,
    settings,
    start_friction,
    whole_arm,
    with_drift,
    with_parameters,
)
from stiction_envs.gap.tables.data import WholeArm
from stiction_envs.measured.thesis_tables import thesis_base
from stiction_envs.robots import load_arm

Array = NDArray[np.float64]
Progress = Callable[[str, float, float], None]
ORDER = (2, 4, 3, 1, 5, 7, 6)
"""Joints with the longest ramps first."""
SEEDS = (0, 1, 2, 3, 4)
"""Seeds of the optimiser, assumed: a parameter that some do not find again is not identified."""
ONE_SEED = (0,)
"""For models on the way: a search from the model before."""
GENERATIONS, ROUNDS = 30, 3
"""Generations of a search; rounds in which the whole arm corrects the lone joint; assumed."""


@dataclass(frozen=True, kw_only=True)
class NestedModel:
    """One statement and what it predicts."""

    key: str
    name: str
    statement: str
    change: list[float]
    """Predicted change |τ_SJE|/|τ_base| − 1 of every cell [-]."""
    found: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    """By joint, where each seed's search ended, best first."""
    loss: float | None = None
    """Loss of the fitted cells, summed over the joints."""


# ---- models without physics ---------------------------------------------------------------------


def nothing(chosen: Sequence[Cell]) -> Array:
    """Dither changes nothing."""
    return np.zeros(len(chosen))


def lookup(chosen: Sequence[Cell]) -> Array:
    """The same configuration and frequency in Table 4.6, whatever the amplitude."""
    table = {(c.configuration, c.row.frequency_hz): c.change for c in chosen if not c.held_out}
    return np.array([table[c.configuration, c.row.frequency_hz] for c in chosen])


def band(chosen: Sequence[Cell]) -> Array:
    """Stiction as a band: the dither's peak adds to the ramp, so that A less torque is needed."""
    return np.array([max(-1.0, -c.row.amplitude_nm / abs(c.row.tau_base_nm)) for c in chosen])


WITHOUT_PHYSICS = (
    ("nothing", "dither does nothing", nothing),
    ("lookup", "Table 4.6 looked up", lookup),
    ("band", "stiction as a band", band),
)


# ---- models with physics ------------------------------------------------------------------------


def _search(
    joint: int,
    whole: WholeArm,
    effects: frozenset[str],
    seeds: tuple[int, ...],
    around: dict[str, float] | None,
    correction: Array | None,
) -> tuple[list[Found], Array]:
    """Return where a joint's searches ended, and what the best predicts of all its cells."""
    every = [c for c in cells() if c.row.joint == joint]
    fitted = [c for c in every if not c.held_out]
    fit = JointFit(joint, fitted, whole, effects, correction=correction)
    if around is not None:
        around = {n: around.get(n, fit.nominal(n)) for n in fit.names}
    found = search(fit, seeds, generations=GENERATIONS, around=around)
    full = JointFit(joint, every, whole, effects)
    return found, full.predict([found[0].parameters])[0]


class NestedModels:
    """Fits the models, keeping each as a row of `ladder.jsonl` in a folder."""

    def __init__(self, folder: Path, *, seeds: Sequence[int] = SEEDS, processes: int = 0) -> None:
        """Go on with the folder's models if they are of the same data and settings."""
        self.seeds = tuple(seeds)
        self.cells = cells()
        self.processes = processes or os.cpu_count() or 1
        self._rows = Rows(folder / "ladder.jsonl", self._fingerprint())

    @property
    def models(self) -> dict[str, NestedModel]:
        """The models that are fitted, by key."""
        return {key: NestedModel(**row) for key, row in self._rows.every.items()}

    def _fingerprint(self) -> str:
        numbers = {
            table: {k: v for k, v in entry.items() if not k.endswith("source")}
            for table, entry in settings().items()
        }
        text = json.dumps([numbers, self.seeds, GENERATIONS, ROUNDS])
        rows = repr([c.row for c in self.cells]) + repr(thesis_base(ROBOT).tau.tolist())
        return hashlib.sha256((text + rows).encode()).hexdigest()

    def _save(self, model: NestedModel) -> NestedModel:
        self._rows.add(model.key, asdict(model))
        return model

    def fit(self, tell: Progress) -> None:
        """Fit every model that the folder has not; ``tell`` hears of progress."""
        for key, name, function in WITHOUT_PHYSICS:
            statement = (function.__doc__ or "").splitlines()[0]
            change = function(self.cells).tolist()
            self._save(NestedModel(key=key, name=name, statement=statement, change=change))
        before, effects = None, frozenset[str]()
        for key, name, statement in PHYSICAL:
            effects |= {key}
            seeds = self.seeds if key == "drift" else ONE_SEED
            about = (key, name, statement)
            before = self.models.get(key) or self._save(
                self._fit(about, tell, effects=effects, around=before, seeds=seeds)
            )
        if "arm" not in self.models:
            self._fit_arm(tell)

    @cached_property
    def _start(self) -> WholeArm:
        """The arm from which every fit starts, calibrated."""
        friction, _ = whole_arm(start_friction(), [])
        return WholeArm(load_arm(ROBOT), friction)

    def _fit(
        self,
        about: tuple[str, str, str],
        tell: Progress,
        *,
        effects: frozenset[str] = ALL,
        whole: WholeArm | None = None,
        around: NestedModel | None = None,
        correction: Array | None = None,
        seeds: tuple[int, ...] = ONE_SEED,
    ) -> NestedModel:
        """Fit all joints with some effects.

        Args:
            about: key, name and statement of the model.
            tell: of progress.
            effects: of the joints.
            whole: the arm; None for that of `start_friction`.
            around: the model from which the first seed starts.
            correction: (all cells,) whole arm minus lone joint [-], NaN where not simulated.
            seeds: of the search.
        """
        key, name, statement = about
        fitted = np.array([not c.held_out for c in self.cells])
        of = {j: np.array([c.row.joint == j for c in self.cells]) for j in ORDER}
        tasks = [
            (
                joint,
                whole or self._start,
                effects,
                seeds,
                None if around is None else around.found[str(joint)][0]["parameters"],
                None if correction is None else correction[of[joint] & fitted],
            )
            for joint in ORDER
        ]
        change = np.zeros(len(self.cells))
        found: dict[str, list[dict[str, Any]]] = {}
        with ProcessPoolExecutor(min(self.processes, len(tasks))) as pool:
            ends = pool.map(_search, *zip(*tasks, strict=True))
            for joint, (best, predicted) in zip(ORDER, ends, strict=True):
                tell(name, len(found) + 1, len(tasks))
                change[of[joint]] = predicted
                found[str(joint)] = [{**asdict(f), "on_bound": f.on_bound} for f in best]
        if "drift" in effects:
            change = with_drift(self.cells, change)
        return NestedModel(
            key=key,
            name=name,
            statement=statement,
            change=change.tolist(),
            found=dict(sorted(found.items())),
            loss=sum(f[0]["loss"] for f in found.values()),
        )

    def _fit_arm(self, tell: Progress) -> None:
        """Correct the lone joints by what the whole arm makes of them, in a few rounds.

        The correction holds near the parameters it was measured at, so each round starts from the
        last. Every joint keeps the round whose fitted cells the whole arm itself met best.
        """
        now = self.models["drift"]
        rows = np.array([not c.held_out for c in self.cells])
        fitted = [c for c in self.cells if not c.held_out]
        kept: dict[str, dict[str, Any]] = {}
        for k in range(ROUNDS + 1):
            tell("whole arm", k, ROUNDS + 2)
            best = {int(j): f[0]["parameters"] for j, f in now.found.items()}
            arm, change = whole_arm(with_parameters(start_friction(), best), fitted)
            whole = WholeArm(load_arm(ROBOT), arm)
            lone = np.zeros(len(fitted))
            for j, found in now.found.items():
                mine = np.array([c.row.joint == int(j) for c in fitted])
                cells = [c for c, one in zip(fitted, mine, strict=True) if one]
                fit = JointFit(int(j), cells, whole)
                parameters = found[0]["parameters"]
                loss = fit.loss(change[mine], parameters)
                if j not in kept or loss < kept[j]["loss"]:
                    kept[j] = {**found[0], "loss": loss, "round": k}
                lone[mine] = fit.predict([parameters])[0]
            if k == ROUNDS:
                break
            correction = np.full(len(self.cells), np.nan)
            correction[rows] = change - lone
            now = self._fit(
                (f"round {k}", f"corrected by the whole arm, {k + 1} of {ROUNDS}", ""),
                tell,
                whole=whole,
                around=now,
                correction=correction,
            )
        tell("whole arm", ROUNDS + 1, ROUNDS + 2)
        best = {int(j): f["parameters"] for j, f in kept.items()}
        _, change = whole_arm(with_parameters(start_friction(), best), self.cells)
        for key, name, values in (
            ("arm", "whole arm, without drift", change),
            ("arm + drift", "whole arm + base drift", with_drift(self.cells, change)),
        ):
            self._save(
                NestedModel(
                    key=key,
                    name=name,
                    statement="the fit carried over to all joints of the plant",
                    change=values.tolist(),
                    found={j: [f] for j, f in kept.items()},
                    loss=sum(f["loss"] for f in kept.values()),
                )
            )
