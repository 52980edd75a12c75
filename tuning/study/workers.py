"""One study, many machines: any number of processes fill it to its budget together.

Each worker is a call of Optuna's `Study.optimize` on one database. The database's heartbeats say
which trials are alive; the setting of a trial whose worker died is queued again. A worker ends when
the study has its budget of outcomes and an outcome of every listed setting (a grid).
Others may then still run a trial each, so a study may hold a few more. Which settings a sampler
tries depends on the timing of the workers; only `record.run` is exact.
"""

import math
import warnings
from collections.abc import Callable, Sequence

from optuna.distributions import FloatDistribution
from optuna.exceptions import UpdateFinishedTrialError
from optuna.trial import FrozenTrial, Trial

from tuning.study import record
from tuning.study.record import Parameters, TrialOutcome, TrialSearch, attributes_of, has_outcome
from tuning.study.samplers import fixed
from tuning.study.storage import writing

Evaluate = Callable[[list[tuple[int, Parameters]]], list[TrialOutcome]]
Progress = Callable[[int, int], None]


def fill(
    searches: Sequence[TrialSearch], evaluate: Evaluate, progress: Progress | None = None
) -> None:
    """Fill the records of all searches: by `record.run`, or together with other machines."""
    together = any(s.record.shared for s in searches)
    (run if together else record.run)(searches, evaluate, progress)


def run(
    searches: Sequence[TrialSearch], evaluate: Evaluate, progress: Progress | None = None
) -> None:
    """Work on records of one database, trial by trial, until each has its budget.

    The arguments are those of `record.run`; ``progress`` counts the trials of all workers.

    Raises:
        ExperimentError: the database does not answer; finished trials are kept.
    """
    total = sum(s.evaluations for s in searches)
    with writing(searches[0].record.place):
        for k, search in enumerate(searches):
            while True:
                if progress is not None:
                    done = sum(len(s.record.trials) for s in searches)
                    progress(min(done, total), total)
                trials = search.record.trials
                if len(trials) >= search.evaluations and not _missing(search, trials):
                    break
                _evaluate_one(k, search, evaluate)


def _evaluate_one(k: int, search: TrialSearch, evaluate: Evaluate) -> None:
    """Evaluate one more trial of the search of number ``k``, under Optuna's heartbeats."""
    study, taken = search.record.study, list[int]()

    def objective(trial: Trial) -> Sequence[float] | float:
        own = search.sampler(trial.number)
        due = _due(search, study.get_trials(deepcopy=False))
        # Optuna asks the study's sampler only when a parameter is suggested
        study.sampler = fixed(due[trial.number % len(due)]) if due else own
        setting = {
            name: trial.suggest_float(name, d.low, d.high, log=d.log)
            if isinstance(d, FloatDistribution)
            else trial.suggest_categorical(name, d.choices)  # type: ignore[attr-defined]
            for name, d in search.space.items()
        }
        study.sampler = own
        (outcome,) = evaluate([(k, setting)])
        try:
            for key, value in attributes_of(outcome).items():
                trial.set_user_attr(key, value)
        except UpdateFinishedTrialError:
            taken.append(trial.number)
            raise
        return outcome.values or math.nan  # NaN: a failed trial

    try:
        study.optimize(objective, n_trials=1)
    except UnboundLocalError as error:  # Optuna's own, after it lost the database
        raise error.__context__ or error from None
    except ValueError:  # what Optuna raises of a trial that another worker called dead
        if not taken:
            raise
        warnings.warn(
            f"study {search.record.name!r}: trial {taken[0]} gave no sign of life for too long: "
            "another worker has it, and its outcome here is dropped",
            stacklevel=2,
        )


def _missing(search: TrialSearch, trials: Sequence[FrozenTrial]) -> list[Parameters]:
    """Return the listed settings that none of some trials has."""
    tried = [t.params for t in trials]
    return [setting for setting in search.first[: search.evaluations] if setting not in tried]


def _due(search: TrialSearch, trials: Sequence[FrozenTrial]) -> list[Parameters]:
    """Return the listed settings without a trial, or else those without an outcome.

    The latter are repeated at the end, in case that their worker is dead.
    """
    alive = [t for t in trials if has_outcome(t) or not t.state.is_finished()]
    return _missing(search, alive) or _missing(search, [t for t in trials if has_outcome(t)])
