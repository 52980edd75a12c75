"""Many machines, one study: no setting of a grid is lost when workers die, and budgets are met."""

import time

import pytest
from optuna.trial import TrialState

from stiction_envs.errors import ExperimentError
from tests.tuning.study.searches import (
    ABOUT,
    IMPATIENT,
    SPACE,
    evaluate,
    launch,
    outcome,
    search,
    work,
)
from tuning.protocol.tune import tune
from tuning.study import record, workers
from tuning.study.samplers import cells

CELLS = sorted(tuple(cell.values()) for cell in cells(SPACE, 4, seed=0))


def start(url, log, count=1, **options):
    return [launch(work, url, log, **options) for _ in range(count)]


def finish(processes, seconds=120):
    for process in processes:
        process.join(seconds)
        if process.exitcode is None:
            process.kill()
        assert process.exitcode == 0


def lines(log, what):
    if not log.exists():
        return []
    return [x.split("\t")[1:] for x in log.read_text().splitlines() if x.startswith(what)]


def trials_of(url, name="random"):
    """Return the trials that have an outcome, checked against what their settings give."""
    found = record.Record(url, f"small-{name}", about=ABOUT, settings=IMPATIENT).trials
    for t in found:
        kept = outcome(t.params)
        assert t.values == (None if kept.values is None else list(kept.values))
        assert t.user_attrs["swing_mm"] == kept.measures["swing_mm"]
    return found


# ---- one worker, on a file: Optuna's heartbeat does nothing there --------------------------------


@pytest.fixture
def alone(tmp_path):
    def make(name="random", **options):
        return search(f"sqlite:///{tmp_path}/s.db", name, settings=IMPATIENT, **options)

    return make


def test_it_is_filled_to_its_budget_by_the_draws_of_a_search_alone(alone):
    """Failed trials count; a trial's draws depend on its number."""
    seen = []
    workers.run([alone()], evaluate, lambda done, total: seen.append((done, total)))
    found = alone().record.trials
    assert {t.state for t in found} == {TrialState.COMPLETE, TrialState.FAIL}
    assert seen == [(done, 10) for done in range(11)]
    exact = search("sqlite://", "random")
    record.run([exact], evaluate)
    assert [t.params for t in found] == [t.params for t in exact.record.trials]
    workers.run([alone()], lambda wanted: pytest.fail("a full study was evaluated"))


def test_an_outcome_that_comes_too_late_is_dropped(alone):
    """Another worker heard no sign of life, and called the trial dead."""
    s = alone(evaluations=4)

    def asleep(wanted):
        if len(s.record.study.get_trials()) == 2:
            s.record.study.tell(1, state=TrialState.FAIL)
        return evaluate(wanted)

    with pytest.warns(UserWarning, match="trial 1 gave no sign of life for too long"):
        workers.run([s], asleep)
    assert [t.number for t in s.record.trials] == [0, 2, 3, 4]


def test_the_cell_of_a_worker_that_fails_or_dies_is_tried_again(alone):
    s = alone("grid", evaluations=16)
    s.record.study.ask(SPACE)  # of a worker that died before its first sign of life

    def broken(wanted):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        workers.run([s], broken)
    workers.run([s], evaluate)
    assert sorted(tuple(t.params.values()) for t in s.record.trials) == CELLS


# ---- many workers, on PostgreSQL -----------------------------------------------------------------


@pytest.mark.slow
def test_a_killed_worker_costs_the_other_only_the_setting_that_it_ran(database, tmp_path):
    """Two share a grid; one is killed in the middle of a trial, and its cell is not lost."""
    log = tmp_path / "log"
    options = {"names": ("grid",), "evaluations": 16, "pause": 0.5}
    victim, other = start(database, log, 2, **options)
    end = time.monotonic() + 60
    while sum(x[0] == str(victim.pid) for x in lines(log, "begin")) < 3:
        assert time.monotonic() < end
        time.sleep(0.02)
    victim.kill()
    victim.join()
    finish([other])
    found = trials_of(database, "grid")
    assert sorted({tuple(t.params.values()) for t in found}) == CELLS
    done = [tuple(x[3:]) for x in lines(log, "end") if x[0] == str(victim.pid)]
    begun = [tuple(x[3:]) for x in lines(log, "begin") if x[0] == str(victim.pid)]
    again = [tuple(x[3:]) for x in lines(log, "end") if x[0] == str(other.pid)]
    assert len(done) >= 2, "both have worked"
    assert not set(done) & set(again), "what was told is not evaluated again"
    assert set(begun) - set(done) <= set(again), "the other has taken what was lost"


@pytest.mark.slow
def test_many_may_begin_at_once_on_an_empty_database(new_database, tmp_path):
    """The workers share the trials and meet the budget, with at most one more trial each."""
    url, log = new_database(tables=False), tmp_path / "log"
    finish(start(url, log, 4, evaluations=12, pause=0.5))
    found = trials_of(url)
    assert 12 <= len(found) <= 15
    assert len({tuple(t.params.values()) for t in found}) == len(found)
    assert len({x[0] for x in lines(log, "end")}) == 4


@pytest.mark.slow
def test_a_database_that_goes_away_ends_the_worker_with_one_line(server, database):
    """The same command goes on when it is back."""
    s = search(database, "random", evaluations=4, settings=IMPATIENT)

    def cut_off(wanted):
        server.stop()
        return evaluate(wanted)

    try:
        with pytest.raises(ExperimentError, match="storage postgresql") as caught:
            workers.run([s], cut_off)
    finally:
        server.start()
    assert "\n" not in str(caught.value)
    assert "gr4vel" not in str(caught.value)
    workers.run([search(database, "random", evaluations=4, settings=IMPATIENT)], evaluate)
    assert len(trials_of(database)) == 4


@pytest.mark.slow
def test_machines_run_the_thesis_protocol_together(database, small_arm, fast, tmp_path):
    """Both end with every file, and those are the files of one that was alone."""
    alone = f"sqlite:///{tmp_path}/alone.db"
    jobs = [(alone, "alone"), (database, "a"), (database, "b")]
    options = {"protocol": fast, "frequencies": (40.0, 15.0), "settings": {"thesis.batch": 2}}
    model = tmp_path / "small.xml"
    every = [
        launch(tune, model, storage=place, out=tmp_path / name, **options) for place, name in jobs
    ]
    finish(every, 300)
    for name in ("base", "frequency", "scale", "intermediate", "final", "verification"):
        texts = {(tmp_path / job / f"{name}.csv").read_text() for _, job in jobs}
        assert len(texts) == 1, name
