"""Workers of a search as Dask tasks, by the code of docs/many_machines.md."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import optuna
import pytest
from optuna.trial import TrialState

from tests.docs.test_pages import DOCS, run_page
from tests.robots.arms import chain
from tuning.settings import tuning_settings
from tuning.study.record import has_outcome
from tuning.study.storage import open_storage
from tuning.study.workers import SURPLUS

distributed = pytest.importorskip("distributed")
PAGE = DOCS / "many_machines.md"
TABLES = ("base", "frequency", "scale", "intermediate", "final", "verification")
CELLS = {"arm-base": 2, "arm-joint1": 6, "arm-joint2": 6, "arm-verification": 4}


def first_to_begin_stops(mark: Path, stage: str, done: float, total: float) -> None:
    """Progress: the first worker in the middle of a batch of the grid leaves its id and stays."""
    if stage != "grid":
        return
    try:
        with mark.open("x") as file:
            file.write(f"{os.getpid()}\n")
    except FileExistsError:
        return
    time.sleep(600)


def studies(url):
    """Return the trials of every study by its name."""
    storage = open_storage(url)
    return {
        name: optuna.load_study(study_name=name, storage=storage).get_trials()
        for name in optuna.get_all_study_names(storage)
    }


def complete(url):
    """Return what is done: study, number, values and time of its end."""
    return {
        (name, t.number, t.values[0], t.datetime_complete)
        for name, trials in studies(url).items()
        for t in trials
        if t.state == TrialState.COMPLETE
    }


def wait_until(true, seconds=120):
    end = time.monotonic() + seconds
    while not (found := true()):
        assert time.monotonic() < end
        time.sleep(0.05)
    return found


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where the page's code runs."""
    (tmp_path / "arm.xml").write_text(chain(2))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def work():
    """The page's worker, a function that no module has."""
    names = {"__name__": "__page__"}
    exec(next(text for kind, text in run_page.blocks(PAGE) if kind == "python"), names)
    return names["work"]


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(folder, work, fast, database, monkeypatch):
    """Killed (-9) in the middle of a batch: its trials alone are begun again."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    options = {
        "protocol": fast,
        "frequencies": (40.0, 15.0),
        "threads": 1,
        "settings": {
            "thesis.batch": 2,
            "shared.heartbeat_s": 1.0,
            "shared.grace_s": 8.0,
            "shared.poll_s": 0.2,
        },
    }
    monkeypatch.setenv("STUDY", f"sqlite:///{folder}/alone.db")
    alone = work("alone", **options)

    monkeypatch.setenv("STUDY", database)
    mark = folder / "pid"
    options["progress"] = partial(first_to_begin_stops, mark)
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    )
    with cluster, distributed.Client(cluster) as client:
        pids = set(client.run(os.getpid).values())
        tasks = [client.submit(work, f"worker{k}", **options) for k in range(2)]
        victim = int(wait_until(lambda: mark.exists() and mark.read_text()))
        assert victim in pids
        # the other one has done a part of the grid
        wait_until(lambda: len(complete(database)) > CELLS["arm-base"])
        before = complete(database)
        os.kill(victim, signal.SIGKILL)
        results = client.gather(tasks)
        assert victim not in client.run(os.getpid).values()

    assert before <= complete(database), "what was done is not evaluated again"
    trials = studies(database)
    for name, count in CELLS.items():
        done = [t for t in trials[name] if t.state == TrialState.COMPLETE]
        assert len(done) == len({tuple(t.params.items()) for t in done}) == count
    everything = [t for study in trials.values() for t in study]
    assert all(t.state.is_finished() for t in everything)
    # two workers may ask for the last trial at once: the surplus one was never evaluated
    given_up = [t for t in everything if t.state == TrialState.FAIL and SURPLUS not in t.user_attrs]
    lost = [t for t in given_up if not has_outcome(t)]
    assert len(lost) == 4, "a batch of either joint"
    for result in results:
        assert result.final == alone.final
        for name in TABLES:
            mine, exact = (r.folder / f"{name}.csv" for r in (result, alone))
            assert mine.read_bytes() == exact.read_bytes(), name


@pytest.mark.slow
def test_the_page_runs(folder, new_database):
    done = subprocess.run(
        [sys.executable, DOCS / "run_page.py", PAGE, folder],
        env={**os.environ, "STUDY": new_database()},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr}"


def test_the_page_tells_the_default_times():
    shared = tuning_settings().shared
    assert (shared.grace_s, shared.give_up_s) == (60.0, 3600.0)
