"""Trials of a search as tables: all of them, the best one, the Pareto front."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from optuna.trial import FrozenTrial, TrialState

from stiction_envs.measured.csv_text import write_rows
from tuning.study.record import CONSTRAINTS, LIMITS, Record


def complete(trials: Sequence[FrozenTrial]) -> list[FrozenTrial]:
    """Return the trials that have values."""
    return [t for t in trials if t.state == TrialState.COMPLETE]


def allowed(trial: FrozenTrial) -> bool:
    """Return whether a trial satisfies all constraints and limits."""
    attributes = trial.user_attrs
    return all(c <= 0 for c in (*attributes.get(CONSTRAINTS, ()), *attributes.get(LIMITS, ())))


def score(trial: FrozenTrial) -> float:
    """Return the score of a trial: its first objective, without penalties."""
    return float(trial.user_attrs.get("objective", trial.values[0]))


def best(trials: Sequence[FrozenTrial]) -> FrozenTrial | None:
    """Return the best allowed trial, the first of equals; None if none is allowed."""
    return min(filter(allowed, complete(trials)), key=score, default=None)


def front(trials: Sequence[FrozenTrial]) -> list[FrozenTrial]:
    """Return the Pareto front of the trials, sorted by the first objective."""
    kept = [t for t in complete(trials) if all(c <= 0 for c in t.user_attrs.get(CONSTRAINTS, ()))]
    values = np.array([t.values for t in kept]).reshape(len(kept), -1)
    out = [
        t
        for t, v in zip(kept, values, strict=True)
        if not np.any(np.all(values <= v, axis=1) & np.any(values < v, axis=1))
    ]
    return sorted(out, key=lambda t: t.values)


def write_trials(
    path: Path,
    records: Mapping[str, Sequence[Record]],
    chosen: Callable[[list[FrozenTrial]], list[FrozenTrial]] = list,
) -> None:
    """Write trials of every stage: study, number, state, allowed, parameters and measures.

    ``chosen`` selects the trials of a study; all by default.
    """
    rows: list[dict[str, str | float]] = []
    found = [
        (k, r.name, t) for k, group in records.items() for r in group for t in chosen(r.trials)
    ]
    for stage, study, t in found:
        measures = {k: v for k, v in t.user_attrs.items() if isinstance(v, int | float | str)}
        row: dict[str, str | float] = {"stage": stage, "study": study, "trial": t.number}
        row |= {"state": t.state.name.lower(), "allowed": int(bool(t.values) and allowed(t))}
        row |= {f"value_{k}": v for k, v in enumerate(t.values or ())}
        rows.append(row | {f"parameter_{k}": v for k, v in t.params.items()} | measures)
    write_rows(path, rows)
