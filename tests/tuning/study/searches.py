"""Cheap searches with every sampler, for the tests of the record; a process can import it alone."""

import multiprocessing
import os
import sqlite3
import time
from pathlib import Path

import optuna
from optuna.distributions import FloatDistribution
from sqlalchemy import event
from sqlalchemy.engine import Engine

from tuning.names import SAMPLERS
from tuning.settings import SharedSettings
from tuning.study import workers
from tuning.study.record import Record, TrialOutcome, TrialSearch, run
from tuning.study.samplers import cells, sampler


@event.listens_for(Engine, "connect")
def _without_waiting_for_the_disk(connection, _):
    """Processes die here, computers do not."""
    if isinstance(connection, sqlite3.Connection):
        connection.execute("PRAGMA synchronous=OFF")


ABOUT = {"robot": "small", "protocol": "search", "version": "1", "bounds": [0.0, 2.0]}
SPACE = {
    "amplitude_nm": FloatDistribution(0.0, 2.0),
    "frequency_hz": FloatDistribution(15.0, 80.0, log=True),
}
STUCK = 0.3
"""Below this amplitude nothing can be measured [N·m]."""


def search(storage, name, *, evaluations=10, batch=3, seed=0, about=ABOUT, **options):
    """Return a search with a sampler by its name."""
    record = Record(str(storage), f"small-{name}", about=about, **options)
    make = sampler(name, SPACE, seed=seed, startup=4, population=4)
    first = ({"amplitude_nm": 1.0, "frequency_hz": 30.0},) if name in ("gp", "tpe") else ()
    if name == "grid":
        first = cells(SPACE, 4, seed)
    return TrialSearch(
        record=record, space=SPACE, sampler=make, evaluations=evaluations, batch=batch, first=first
    )


def outcome(params):
    """Return what a setting gives: a valley, a constraint, and nothing at small amplitudes."""
    a, f = params["amplitude_nm"], params["frequency_hz"]
    value = None if a < STUCK else ((a - 1.3) ** 2 + 0.1 * (f / 20 - 1) ** 2,)
    measures = {"swing_mm": a / f, "traces": [a / 3, f / 7], "word": "ok"}
    return TrialOutcome(values=value, constraints=(a / f - 0.05,), measures=measures)


def evaluate(wanted):
    """Return the outcomes of a list of (number of the search, setting)."""
    return [outcome(params) for _, params in wanted]


def trials(record):
    """Return what a study holds, all but times."""
    return [
        (t.number, t.state.name, t.values, t.params, t.user_attrs, t.distributions)
        for t in record.trials
    ]


def fill_slowly(storage):
    """Fill a study per sampler: what a test kills."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)

    def slowly(wanted):
        time.sleep(0.01)
        return evaluate(wanted)

    run([search(storage, name, evaluations=15) for name in SAMPLERS], slowly)


def launch(target, *arguments, **options):
    """Start a process that has this module loaded."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.tuning.study.searches"])
    process = context.Process(target=target, args=arguments, kwargs=options)
    process.start()
    return process


# ---- shared by machines --------------------------------------------------------------------------

IMPATIENT = SharedSettings(connect_s=3.0, heartbeat_s=1.0, grace_s=4.0)


def work(storage, log, *, names=("random",), evaluations=24, pause=0.5):
    """Work as one of several machines; every evaluated setting is a line in ``log``."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    options = {"evaluations": evaluations, "settings": IMPATIENT}
    searches = [search(storage, name, **options) for name in names]
    me = os.getpid()

    def slowly(wanted):
        ((k, params),) = wanted
        note(log, "begin", me, time.time(), names[k], *params.values())
        time.sleep(pause)
        note(log, "end", me, time.time(), names[k], *params.values())
        return evaluate(wanted)

    workers.run(searches, slowly)


def note(log, *what):
    """Append a line, whole or not at all."""
    with Path(log).open("a") as file:
        file.write("\t".join(map(str, what)) + "\n")
