"""One study, many machines: any number of processes fill it to its budget together.

    claim a batch of trials -> evaluate -> tell, trial by trial          (every worker)
    a trial without a heartbeat -> failed, its setting queued again      (any worker)

A worker claims a trial by creating it in the database, where it runs under the worker's heartbeat.
Trials are counted by slots: a trial that was queued again takes the slot of the one that died. If
two workers ask for a trial beyond the budget at once, it is discarded before it is evaluated. So
the number of trials with an outcome is the requested one, and none repeats another. Which settings
are tried depends on the timing of the workers; only `record.run` is exact.
"""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, TypeVar

import optuna
from optuna.distributions import BaseDistribution
from optuna.exceptions import StorageInternalError, UpdateFinishedTrialError
from optuna.samplers import BaseSampler
from optuna.storages import fail_stale_trials
from optuna.study import Study
from optuna.trial import FrozenTrial, Trial, TrialState
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError, PendingRollbackError

from stiction_envs.errors import ExperimentError
from tuning.settings import SharedSettings
from tuning.study import record
from tuning.study.record import (
    Outcome,
    Parameters,
    Search,
    attributes_of,
    has_outcome,
    retried,
)
from tuning.study.samplers import fixed
from tuning.study.storage import retry

T = TypeVar("T")
Evaluate = Callable[[list[tuple[int, Parameters]]], list[Outcome]]
Progress = Callable[[int, int], None]
SURPLUS = "surplus"
"""User attribute of a trial beyond the budget that was not evaluated."""


def fill(searches: Sequence[Search], evaluate: Evaluate, progress: Progress | None = None) -> None:
    """Fill the records of all searches: alone and exactly, or together with other machines.

    The arguments are those of `record.run`; `Record.shared` selects which.
    """
    together = any(s.record.shared for s in searches)
    (run if together else record.run)(searches, evaluate, progress)


def run(searches: Sequence[Search], evaluate: Evaluate, progress: Progress | None = None) -> None:
    """Work on shared records until every one has its budget of outcomes, from any worker.

    Args:
        searches: searches to fill; all in one database.
        evaluate: outcomes of a list of (number of the search, setting), as of `record.run`.
        progress: called with the number of finished trials and the total, of all workers.

    Raises:
        ExperimentError: the database did not answer for ``give_up_s``.
    """
    settings = searches[0].record.settings
    retries = _Retries(searches[0].record.place, settings)
    fills = [_SharedFill(s, retries) for s in searches]
    total = sum(s.evaluations for s in searches)
    with _heartbeats(fills, retries, settings), _trials_returned(fills):
        while True:
            due = [(k, trial) for k, one in enumerate(fills) for trial in one.claim()]
            if progress is not None:
                progress(sum(one.done for one in fills), total)
            if due:
                outcomes = evaluate([(k, dict(trial.params)) for k, trial in due])
                for (k, trial), outcome in zip(due, outcomes, strict=True):
                    fills[k].tell(trial, outcome)
            elif all(one.done >= one.search.evaluations for one in fills):
                return
            else:  # others run the last trials, and may die
                time.sleep(settings.poll_s)


class _SharedFill:
    """One search, as seen by this worker."""

    def __init__(self, search: Search, retries: _Retries) -> None:
        self.search, self._retries = search, retries
        self.study: Study = search.record.study
        self.study.sampler = _BySlot(search)
        self._storage: Any = self.study._storage  # with Optuna's heartbeats
        self.done = 0
        """Outcomes in the database, of all workers."""
        self.mine: dict[int, Trial] = {}
        """Trials that this worker runs, by number."""
        self._given_heartbeat: set[int] = set()
        self._orphans: dict[int, float] = {}
        self._trouble = retries.troubles

    def claim(self) -> list[Trial]:
        """Return at most a batch of trials to evaluate; none when other workers run the rest."""
        s = self.search
        while len(self.mine) < s.batch:
            trials = self._retries(self._look)
            slots = _slots(trials)
            self.done = sum(has_outcome(t) for t in slots)
            waiting = any(t.state == TrialState.WAITING for t in trials)
            if len(slots) >= s.evaluations and not waiting:
                break
            trial = self._retries(self._ask)
            self.mine[trial.number] = trial
            self._retries(partial(self._storage.record_heartbeat, trial._trial_id))
            if not self._wanted(self._retries(self._trials), trial.number):
                self._retries(partial(self._give_up, trial))
                del self.mine[trial.number]
        return list(self.mine.values())

    def tell(self, trial: Trial, outcome: Outcome) -> None:
        """Store an outcome once, however often the connection breaks."""

        def write() -> FrozenTrial:
            for key, value in attributes_of(outcome).items():
                trial.set_user_attr(key, value)
            state = TrialState.FAIL if outcome.values is None else None
            values = None if outcome.values is None else list(outcome.values)
            return self.study.tell(trial, values, state=state, skip_if_finished=True)

        try:
            stored = self._retries(write)
            lost = stored.state == TrialState.FAIL and outcome.values is not None
        except UpdateFinishedTrialError:
            # ours, stored before the connection broke, or failed by another worker
            found = self._retries(self._trials)
            lost = not any(t.number == trial.number and has_outcome(t) for t in found)
        self.mine.pop(trial.number, None)
        if lost:
            warnings.warn(
                f"study {self.search.record.name!r}: trial {trial.number} took longer than its "
                "signs of life: another worker has it, and its outcome here is dropped",
                stacklevel=2,
            )

    def give_back(self) -> None:
        """Queue the settings of this worker's trials for others, as far as possible."""
        for trial in self.mine.values():
            failed = self.study.tell(trial, state=TrialState.FAIL, skip_if_finished=True)
            if not has_outcome(failed):
                retry(self.study, failed)
        self.mine = {}

    def beat(self) -> None:
        """Send a heartbeat for every trial that this worker runs."""
        for trial in list(self.mine.values()):
            self._storage.record_heartbeat(trial._trial_id)

    def _trials(self) -> list[FrozenTrial]:
        return self.study.get_trials(deepcopy=False)

    def _look(self) -> list[FrozenTrial]:
        """Return all trials, after queueing those of dead workers again."""
        if self._retries.silent or self._trouble != self._retries.troubles:
            # other workers could not send heartbeats either
            self._trouble = self._retries.troubles
            self._given_heartbeat.clear()
        trials, now = self._trials(), time.monotonic()
        others = [t for t in trials if t.state == TrialState.RUNNING and t.number not in self.mine]
        for t in others:
            if t.number not in self._given_heartbeat:
                # a worker that died between creating a trial and its first heartbeat leaves one
                # that Optuna never calls stale; every other trial only gets one more heartbeat
                self._storage.record_heartbeat(t._trial_id)
                self._given_heartbeat.add(t.number)
        if others:
            self.beat()  # after a pause our own would be called dead first
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
                fail_stale_trials(self.study)
            trials = self._trials()
        for t in _slots(trials):
            # failed by a worker that died before it queued the setting again
            orphan = t.state == TrialState.FAIL and not has_outcome(t)
            grace = self.search.record.settings.grace_s
            if orphan and now - self._orphans.setdefault(t.number, now) > grace:
                retry(self.study, t)
                trials = self._trials()
        return trials

    def _ask(self) -> Trial:
        with warnings.catch_warnings():
            # Optuna does not know that we send the heartbeat ourselves
            warnings.filterwarnings("ignore", message="Heartbeat of storage")
            return self.study.ask(dict(self.search.space))

    def _wanted(self, trials: Sequence[FrozenTrial], number: int) -> bool:
        """Return whether a trial has a slot: others may have claimed the last one before."""
        slots = _slots(trials[: number + 1])
        return number in {t.number for t in slots} and len(slots) <= self.search.evaluations

    def _give_up(self, trial: Trial) -> None:
        with suppress(UpdateFinishedTrialError):  # by a worker that saw no heartbeat
            trial.set_user_attr(SURPLUS, True)
            self.study.tell(trial, state=TrialState.FAIL, skip_if_finished=True)


class _BySlot(BaseSampler):
    """The sampler of each trial by its slot, which a trial that is queued again inherits."""

    def __init__(self, search: Search) -> None:
        self._search = search
        self._made: dict[int, BaseSampler] = {}

    def before_trial(self, study: Study, trial: FrozenTrial) -> None:
        first = trial.system_attrs.get("failed_trial", trial.number)
        s, slot = self._search, _slot(study.get_trials(deepcopy=False), first)
        known = slot < len(s.first)
        sampler = fixed(s.first[slot]) if known else s.sampler(slot)
        self._made[trial.number] = sampler
        sampler.before_trial(study, trial)

    def infer_relative_search_space(
        self, study: Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        return self._made[trial.number].infer_relative_search_space(study, trial)

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, object]:
        return self._made[trial.number].sample_relative(study, trial, search_space)

    def sample_independent(
        self,
        study: Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> object:
        sampler = self._made[trial.number]
        return sampler.sample_independent(study, trial, param_name, param_distribution)

    def after_trial(
        self,
        study: Study,
        trial: FrozenTrial,
        state: TrialState,
        values: Sequence[float] | None,
    ) -> None:
        self._made[trial.number].after_trial(study, trial, state, values)


class _Retries:
    """Calls the database until it answers."""

    def __init__(self, place: str, settings: SharedSettings) -> None:
        self._place, self._settings = place, settings
        self.troubles = 0
        """Number of calls that it did not answer."""
        self.beaten = time.monotonic()
        """Time of this worker's last heartbeats [s]."""

    @property
    def silent(self) -> bool:
        """Whether this worker sent no heartbeat for so long that the database counts as away."""
        s = self._settings
        return time.monotonic() - self.beaten > s.beats * s.heartbeat_s

    def __call__(self, ask: Callable[[], T]) -> T:
        """Return what ``ask`` returns; it may be called again after it was half done."""
        began = None
        while True:
            try:
                answer = ask()
            except (StorageInternalError, DBAPIError) as error:
                if not _out_of_reach(error):
                    raise
                self.troubles += 1
                now = time.monotonic()
                if began is None:
                    began = now
                    self._say("does not answer: waiting for it")
                if now - began > self._settings.give_up_s:
                    raise ExperimentError(
                        f"storage {self._place}: no answer for {now - began:.0f} s; finished "
                        "trials are kept, run the same command again to go on"
                    ) from None
                time.sleep(self._settings.retry_s)
                continue
            if began is not None:
                self._say(f"answers again after {time.monotonic() - began:.0f} s")
            return answer

    def _say(self, what: str) -> None:
        warnings.warn(f"storage {self._place}: {what}", stacklevel=3)


@contextmanager
def _heartbeats(
    fills: Sequence[_SharedFill], retries: _Retries, settings: SharedSettings
) -> Iterator[None]:
    """Send heartbeats, from a thread, for the trials that this worker runs."""
    end = threading.Event()

    def beat() -> None:
        wait = settings.heartbeat_s
        while not end.wait(wait):
            try:
                for one in fills:
                    one.beat()
                if retries.silent:
                    retries.troubles += 1  # it hung, and returned normally
                retries.beaten = time.monotonic()
                wait = settings.heartbeat_s
            except (StorageInternalError, DBAPIError):
                # the main thread reports it if it persists at its next call
                retries.troubles += 1
                wait = min(settings.retry_s, settings.heartbeat_s)

    retries.beaten = time.monotonic()
    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


@contextmanager
def _trials_returned(fills: Sequence[_SharedFill]) -> Iterator[None]:
    """Give trials back when this worker is interrupted or fails."""
    try:
        yield
    except BaseException:
        with suppress(StorageInternalError, DBAPIError, UpdateFinishedTrialError):
            for one in fills:  # others notice the rest by the missing heartbeat
                one.give_back()
        raise


def _slots(trials: Sequence[FrozenTrial]) -> list[FrozenTrial]:
    """Return the last trial of every slot: neither surplus, nor queued again, nor a repetition."""
    again, seen = retried(trials), set()
    out = []
    for t in trials:
        before = _before(t)
        repeated = before is not None and before in seen
        seen.add(before)
        if not (repeated or SURPLUS in t.user_attrs or t.number in again):
            out.append(t)
    return out


def _slot(trials: Sequence[FrozenTrial], first: int) -> int:
    """Return the slot that begins with a trial of a number: how many began before."""
    return sum(_before(t) is None and SURPLUS not in t.user_attrs for t in trials[:first])


def _before(trial: FrozenTrial) -> int | None:
    """Return the number of the trial that this one was queued for again."""
    history = trial.system_attrs.get("retry_history")
    return int(history[-1]) if history else None


def _out_of_reach(error: BaseException) -> bool:
    """Return whether a database may answer later: no connection, a restart, a deadlock."""
    cause: BaseException | None = error
    while cause is not None:
        # the last is what remains of a connection that broke while Optuna tried another query
        if isinstance(cause, OperationalError | InterfaceError | PendingRollbackError):
            return True
        if isinstance(cause, DBAPIError) and cause.connection_invalidated:
            return True
        cause = cause.__cause__
    return False
