"""Grid search of the thesis's protocol as Optuna studies, one per joint.

The simulation measures many trials at once, so the studies are driven by ask and tell: all joints'
open trials are collected, measured in one batch, and told.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence

import optuna
from optuna.trial import FrozenTrial, Trial, TrialState

from stiction_envs.errors import StictionError

Cell = tuple[float, ...]


class AskTellGridSampler(optuna.samplers.GridSampler):
    """Grid sampler for ask and tell: there is no loop that it could stop when the grid is full."""

    def after_trial(
        self,
        study: optuna.Study,
        trial: FrozenTrial,
        state: TrialState,
        values: Sequence[float] | None,
    ) -> None:
        """Do nothing; the base class would raise outside of ``study.optimize``."""


class GridStudy:
    """One joint's study over a full grid; continues whatever its storage holds."""

    def __init__(
        self,
        name: str,
        storage: str,
        grid: Mapping[str, Sequence[float]],
        seed: int,
        *,
        fingerprint: str = "",
    ) -> None:
        """Create or load the study.

        Args:
            name: name of the study.
            storage: Optuna storage URL.
            grid: values of each parameter.
            seed: of the order in which cells are asked for; results do not depend on it.
            fingerprint: what defines the experiment; a study of another one is not continued.

        Raises:
            StictionError: the storage has a study of that name from another experiment.
        """
        self.names = tuple(grid)
        self.cells: list[Cell] = list(itertools.product(*grid.values()))
        self._values = {k: sorted(v) for k, v in grid.items()}
        sampler = AskTellGridSampler(grid, seed=seed)
        self.study = optuna.create_study(
            study_name=name,
            storage=storage,
            sampler=sampler,
            direction="minimize",
            load_if_exists=True,
        )
        known = self.study.user_attrs.get("fingerprint")
        if known is None and not self.study.get_trials():
            self.study.set_user_attr("fingerprint", fingerprint)
        elif known != fingerprint:
            raise StictionError(
                f"study {name!r} in this storage is of another run (other robot, friction, options "
                "or version): choose another --study or --storage"
            )

    def _cell(self, trial: Trial | FrozenTrial) -> Cell | None:
        if set(trial.params) != set(self.names):
            return None
        return tuple(trial.params[k] for k in self.names)

    def pending(self) -> dict[Cell, int]:
        """Return the trial number of every cell that has no value yet, asking for new trials."""
        done = {self._cell(t) for t in self.study.get_trials(states=[TrialState.COMPLETE])}
        missing = [c for c in self.cells if c not in done]
        open_: dict[Cell, int] = {}
        for t in self.study.get_trials(states=[TrialState.RUNNING]):
            # of a run that was interrupted: its measurement is still wanted
            cell = self._cell(t)
            if cell in missing and cell not in open_:
                open_[cell] = t.number
            else:
                self.study.tell(t.number, state=TrialState.FAIL)
        for cell in missing:
            if cell in open_:
                continue
            trial = self.study.ask()
            asked = tuple(trial.suggest_categorical(k, self._values[k]) for k in self.names)
            if asked in missing and asked not in open_:
                open_[asked] = trial.number
                continue
            # a torn trial made the sampler believe this cell was visited
            self.study.tell(trial.number, state=TrialState.FAIL)
        for cell in [c for c in missing if c not in open_]:
            self.study.enqueue_trial(dict(zip(self.names, cell, strict=True)))
            trial = self.study.ask()
            for k in self.names:
                trial.suggest_categorical(k, self._values[k])
            open_[cell] = trial.number
        return open_

    def tell(self, number: int, value: float) -> None:
        """Report the value of a trial; NaN (a joint that stuck) counts as failed."""
        if value != value:
            self.study.tell(number, state=TrialState.FAIL)
        else:
            self.study.tell(number, value)

    def values(self) -> dict[Cell, float]:
        """Return the value of every finished cell."""
        out: dict[Cell, float] = {}
        for t in self.study.get_trials(states=[TrialState.COMPLETE]):
            cell = self._cell(t)
            if cell is not None and t.value is not None:
                out[cell] = float(t.value)
        return out


def run_grids(
    studies: Sequence[GridStudy],
    evaluate: Callable[[list[tuple[int, Cell]]], dict[tuple[int, Cell], float]],
) -> list[dict[Cell, float]]:
    """Fill the grids of all studies in one batch.

    Args:
        studies: one per joint.
        evaluate: values of a list of (study index, cell).

    Returns:
        For each study the value of every cell.
    """
    pending = [s.pending() for s in studies]
    wanted = [(i, cell) for i, cells in enumerate(pending) for cell in cells]
    values = evaluate(wanted) if wanted else {}
    for (i, cell), value in values.items():
        studies[i].tell(pending[i][cell], value)
    return [s.values() for s in studies]
