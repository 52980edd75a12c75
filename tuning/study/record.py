"""The record of a search: one Optuna study, the only place where trials are stored.

    proposals(history) -> evaluate, a batch in one call -> Record.add, trial by trial

A finished trial is written in one transaction. What the sampler proposes depends on the seed, the
trial's number and the trials of earlier batches, never on what the process did before. A search
that was killed therefore starts again with its last batch: trials, values and order are those of a
run that was never stopped.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import optuna
from optuna.distributions import BaseDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial, TrialState

from stiction_envs.errors import StictionError
from stiction_envs.reporting.json_text import JsonRecord, plain
from tuning.settings import SharedSettings
from tuning.study import storage as storages
from tuning.study.storage import only_writer, writing

Parameters = dict[str, Any]
"""Setting of a trial by name: numbers, and choices of whatever kind a list has."""
Space = Mapping[str, BaseDistribution]
CONSTRAINTS = "constraints"
"""User attribute of a trial: its constraints, feasible where all are at most 0."""
ABOUT = "about"  # User attribute of a study: its definition, each part as JSON
LIMITS = "limits"
"""User attribute: how far a trial passes limits that the sampler need not know; at most 0."""
UNMEASURED = "unmeasured"
"""User attribute of a failed trial that was evaluated although nothing could be measured."""


@dataclass(frozen=True, kw_only=True)
class TrialOutcome:
    """Result of a setting."""

    values: tuple[float, ...] | None
    """Objectives, all minimised; None where nothing could be measured (a joint that stuck)."""
    constraints: tuple[float, ...] = ()
    measures: JsonRecord = field(default_factory=dict)
    """Other results to store: numbers, strings, lists of them."""


class Record:
    """Trials of one search, in the order of their numbers."""

    def __init__(
        self,
        storage: str,
        name: str,
        *,
        objectives: int = 1,
        about: Mapping[str, object],
        settings: SharedSettings | None = None,
    ) -> None:
        """Open the study, or create it.

        Args:
            storage: URL of `storage.open_storage`.
            name: name of the study.
            objectives: number of values of a trial, all minimised.
            about: definition of the search; a study with another definition is not continued.
            settings: time limits for a shared database; None for the defaults.

        Raises:
            StictionError: a storage that cannot be opened, or a study with another definition.
        """
        url = storages.parse(storage)
        self.name = name
        self.shared = storages.is_shared(url)
        """Whether several machines fill it: `workers.run` is used instead of `run`."""
        self.place = storages.shown(url)
        """The storage as it may be printed."""
        self.file = storages.storage_file(url)
        """File of the storage, None for a database server."""
        opened = storages.open_storage(storage, settings)
        defining = {"objectives": objectives, **about}
        own = {key: json.dumps(plain(part), sort_keys=True) for key, part in defining.items()}
        with writing(self.place, StictionError, "cannot be written: "):
            self.study = optuna.create_study(
                study_name=name,
                storage=opened,
                directions=["minimize"] * objectives,
                load_if_exists=True,
            )
            known = self.study.user_attrs.get(ABOUT)
            if known is None and not self.study.get_trials(deepcopy=False):
                self.study.set_user_attr(ABOUT, own)
                known = self.study.user_attrs[ABOUT]  # another machine may have written it
        if known is None:
            raise StictionError(
                f"study {name!r}: was not made by stiction tune: expected another study"
            )
        if other := [key for key in own if known.get(key) != own[key]]:
            raise StictionError(
                f"study {name!r}: was made with another {', '.join(other)}: expected the same, or "
                "another study or storage"
            )

    @property
    def trials(self) -> list[FrozenTrial]:
        """Trials with an outcome, in the order of their numbers."""
        with writing(self.place):
            return [t for t in self.study.get_trials(deepcopy=False) if has_outcome(t)]

    def add(self, trial: FrozenTrial) -> None:
        """Write a finished trial in one transaction."""
        with writing(self.place):
            self.study.add_trial(trial)


def has_outcome(trial: FrozenTrial) -> bool:
    """Return whether a trial was evaluated. A failed one was, unless its worker died."""
    failed = trial.state == TrialState.FAIL
    return trial.state == TrialState.COMPLETE or (failed and UNMEASURED in trial.user_attrs)


def attributes_of(outcome: TrialOutcome) -> Parameters:
    """Return an outcome as user attributes of its trial."""
    out = {**outcome.measures, CONSTRAINTS: list(outcome.constraints)}
    return {**out, UNMEASURED: True} if outcome.values is None else out


@dataclass(frozen=True, kw_only=True)
class TrialSearch:
    """One record, and how to fill it."""

    record: Record
    space: Space
    sampler: Callable[[int], BaseSampler]
    """Makes the sampler of a trial of a given number; see `samplers.sampler`."""
    evaluations: int
    batch: int = 1  # Trials proposed together; none of them knows the outcomes of the others
    first: tuple[Parameters, ...] = ()
    """Settings that are known beforehand, tried before the sampler's: a start, or all of a grid."""


def run(
    searches: Sequence[TrialSearch],
    evaluate: Callable[[list[tuple[int, Parameters]]], list[TrialOutcome]],
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Fill the records of all searches, batch by batch, all searches' batches in one call.

    Args:
        searches: searches to fill.
        evaluate: returns the outcomes of a list of (number of the search, setting), each
            independent of the rest of the list.
        progress: called with the number of finished trials and the total.

    Raises:
        StictionError: another process fills a record.
    """
    with ExitStack() as held:
        for file in sorted({s.record.file for s in searches if s.record.file is not None}):
            held.enter_context(only_writer(file))
        fills = [_Fill(s) for s in searches]
        total = sum(s.evaluations for s in searches)
        while True:
            if progress is not None:
                progress(sum(f.done for f in fills), total)
            due = [(k, trial) for k, fill in enumerate(fills) for trial in fill.propose()]
            if not due:
                return
            outcomes = evaluate([(k, trial.params) for k, trial in due])
            for (k, trial), outcome in zip(due, outcomes, strict=True):
                fills[k].tell(trial, outcome)


class _Fill:
    """A search in memory: the stored trials of whole batches, and the batch that is evaluated.

    A batch that was stored in part is evaluated again: its trials are known to be the same.
    """

    def __init__(self, search: TrialSearch) -> None:
        known = search.record.trials
        self.search, self.done = search, len(known)
        self._memory = optuna.create_study(
            directions=search.record.study.directions, sampler=search.sampler(0)
        )
        for trial in known[: self.done // search.batch * search.batch]:
            self._memory.add_trial(trial)

    def propose(self) -> list[optuna.Trial]:
        """Propose the next batch; nothing where the budget is used up."""
        s, out = self.search, list[optuna.Trial]()
        start = len(self._memory.get_trials(deepcopy=False))
        end = min(start + s.batch, s.evaluations) if self.done < s.evaluations else start
        for number in range(start, end):
            self._memory.sampler = s.sampler(number)
            if number < len(s.first):
                self._memory.enqueue_trial(s.first[number])
            out.append(self._memory.ask(dict(s.space)))
        return out

    def tell(self, trial: optuna.Trial, outcome: TrialOutcome) -> None:
        """Store an outcome, unless it is stored."""
        for key, value in attributes_of(outcome).items():
            trial.set_user_attr(key, value)
        # `tell` lets the sampler store what it needs later; it must be this trial's own
        self._memory.sampler = self.search.sampler(trial.number)
        if outcome.values is None:
            self._memory.tell(trial, state=TrialState.FAIL)
        else:
            self._memory.tell(trial, list(outcome.values))
        if trial.number >= self.done:
            self.search.record.add(self._memory.get_trials(deepcopy=True)[trial.number])
            self.done += 1
