"""Many machines, one study: no trial is lost or counted twice when workers die."""

from __future__ import annotations

import dataclasses
import itertools
import random
import threading
import time
import warnings

import optuna
import pytest
from optuna.trial import TrialState, create_trial

from stiction_envs.errors import ExperimentError, StictionError
from tests.tuning.study.searches import (
    ABOUT,
    IMPATIENT,
    SPACE,
    evaluate,
    launch,
    search,
    tune_small,
    work,
)
from tuning.study import record, workers
from tuning.study.samplers import grid
from tuning.study.storage import open_storage


@pytest.fixture(autouse=True)
def quiet():
    optuna.logging.set_verbosity(optuna.logging.ERROR)


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


def wait_for(log, what, count, seconds=60):
    end = time.monotonic() + seconds
    while len(lines(log, what)) < count:
        assert time.monotonic() < end, f"{what}: {len(lines(log, what))} of {count}"
        time.sleep(0.02)


def raw(url, name="random"):
    return record.Record(url, f"small-{name}", about=ABOUT, settings=IMPATIENT).study.get_trials()


def check(url, evaluations, name="random"):
    """Check that the budget is met by distinct trials that have an outcome."""
    found = record.Record(url, f"small-{name}", about=ABOUT, settings=IMPATIENT).trials
    assert len(found) == evaluations
    if name != "nsga2":  # whose children may be like their parents
        assert len({tuple(t.params.values()) for t in found}) == evaluations
    for t in found:
        kept = evaluate([(0, t.params)])[0]
        assert t.values == (None if kept.values is None else list(kept.values))
        assert t.user_attrs["swing_mm"] == kept.measures["swing_mm"]
    everything = raw(url, name)
    assert sum(t.state == TrialState.COMPLETE for t in everything) == sum(
        t.state == TrialState.COMPLETE for t in found
    )
    assert all(t.state.is_finished() for t in everything)
    again = [n for t in everything for n in t.system_attrs.get("retry_history", [])]
    assert all(everything[n].state == TrialState.FAIL for n in again), "told, and queued again"
    return everything


# ---- one worker, on a file: what is claimed and counted ------------------------------------------


@pytest.fixture
def alone(tmp_path):
    """A study on a file, filled as if it were shared; the heartbeat does nothing there."""

    def make(**options):
        return search(f"sqlite:///{tmp_path}/s.db", "random", settings=IMPATIENT, **options)

    return make


def test_it_is_filled_to_its_budget(alone):
    seen = []
    workers.run([alone()], evaluate, lambda done, total: seen.append((done, total)))
    found = alone().record
    assert [t.number for t in found.trials] == list(range(10))
    assert len(found.study.get_trials()) == 10
    assert seen == [(0, 10), (3, 10), (6, 10), (9, 10), (10, 10)]
    workers.run([alone()], lambda wanted: pytest.fail("a full study was evaluated"))


def test_alone_and_together_draw_alike(alone):
    """Draws come from the trial's number; a single worker gives what `record.run` gives."""
    workers.run([alone()], evaluate)
    exact = search("sqlite://", "random")
    record.run([exact], evaluate)
    assert [t.params for t in alone().record.trials] == [t.params for t in exact.record.trials]


def test_the_first_settings_are_tried_first(alone):
    first = ({"amplitude_nm": 1.0, "frequency_hz": 30.0},)
    s = alone()
    workers.run([record.Search(**{**vars(s), "first": first})], evaluate)
    assert s.record.trials[0].params == first[0]


def test_what_was_asked_for_beyond_the_budget_is_given_up(alone):
    """Two workers ask for the last trial at once: the later one is not evaluated."""
    s = alone(evaluations=4, batch=4)

    def another_is_quicker(wanted):
        assert len(wanted) == 4
        return evaluate(wanted)

    ask = workers._SharedFill._ask

    def asked_by_two(one):
        if len(one.study.get_trials()) == 3:  # another worker's, between our look and our asking
            other = one.study.ask(SPACE)
            kept = record.attributes_of(evaluate([(0, other.params)])[0])
            for key, value in kept.items():
                other.set_user_attr(key, value)
            one.study.tell(other, 1.0)
        return ask(one)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workers._SharedFill, "_ask", asked_by_two)
        workers.run([s], evaluate)
    states = [t.state for t in s.record.study.get_trials()]
    assert len(s.record.trials) == 4
    assert len(states) == 5
    assert states[4] == TrialState.FAIL
    assert [t.number for t in s.record.trials] == [0, 1, 2, 3]


def test_a_setting_queued_twice_is_evaluated_once(alone):
    """A worker that dies while it queues a setting again leaves that to others, maybe to two."""
    s = alone(evaluations=3, batch=1)
    dead = s.record.study.ask(SPACE)
    told = s.record.study.tell(dead, state=TrialState.FAIL)
    for _ in range(2):
        workers.retry(s.record.study, told)
    workers.run([s], evaluate)
    assert [t.number for t in s.record.trials] == [1, 3, 4]
    assert s.record.trials[0].params == dead.params


def test_a_setting_that_nobody_queued_again_is(alone):
    s = alone(evaluations=3, batch=1)
    dead = s.record.study.ask(SPACE)
    s.record.study.tell(dead, state=TrialState.FAIL)
    workers.run([s], evaluate)
    assert len(s.record.trials) == 3
    assert s.record.trials[0].params == dead.params, "in its place, though it came last"
    assert [t.number for t in s.record.trials] == [3, 1, 2]


def test_what_cannot_be_measured_counts(alone):
    s = alone(evaluations=20)
    workers.run([s], evaluate)
    states = {t.state for t in s.record.trials}
    assert states == {TrialState.COMPLETE, TrialState.FAIL}
    assert len(s.record.study.get_trials()) == 20


def test_a_worker_that_fails_gives_its_batch_back(alone):
    s = alone(batch=3)

    def broken(wanted):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        workers.run([s], broken)
    states = [t.state for t in s.record.study.get_trials()]
    assert states == [TrialState.FAIL] * 3 + [TrialState.WAITING] * 3
    workers.run([s], evaluate)
    assert len(s.record.trials) == 10
    assert [t.number for t in s.record.trials][:3] == [3, 4, 5]


def test_an_outcome_that_comes_too_late_is_dropped(alone):
    """Another worker heard no sign of life, and has queued the setting again."""
    s = alone(evaluations=4, batch=2)
    late = []

    def asleep(wanted):
        if not late:
            late.append(wanted[1][1])
            told = s.record.study.tell(1, state=TrialState.FAIL)
            workers.retry(s.record.study, told)
        return evaluate(wanted)

    with pytest.warns(UserWarning, match="trial 1 took longer than its signs of life"):
        workers.run([s], asleep)
    assert [t.number for t in s.record.trials] == [0, 2, 3, 4]
    assert s.record.trials[1].params == late[0]


def test_the_storage_says_which_way(alone, monkeypatch):
    ways = []
    monkeypatch.setattr(workers, "run", lambda *_: ways.append("together"))
    monkeypatch.setattr(record, "run", lambda *_: ways.append("alone"))
    s = alone()
    workers.fill([s], evaluate)
    s.record.shared = True
    workers.fill([s], evaluate)
    assert ways == ["alone", "together"]


def test_slots_are_counted_by_chains_of_trials():
    def trial(number, state=TrialState.COMPLETE, history=(), **attributes):
        values = [0.0] if state == TrialState.COMPLETE else None
        made = create_trial(
            state=state,
            values=values,
            user_attrs=attributes,
            system_attrs={"retry_history": list(history)} if history else {},
        )
        made.number = number
        return made

    fail = TrialState.FAIL
    trials = [
        trial(0),
        trial(1, fail),  # died, queued again as 4
        trial(2, fail, surplus=True),
        trial(3, fail, unmeasured=True),
        trial(4, fail, history=[1]),  # died too, queued again as 6
        trial(5, history=[1]),  # the same setting as 4, by another worker
        trial(6, TrialState.RUNNING, history=[1, 4]),
        trial(7, fail),  # died, and nobody has queued it yet
    ]
    assert [t.number for t in workers._slots(trials)] == [0, 3, 6, 7]
    assert [workers._slot(trials, first) for first in (0, 1, 3, 7)] == [0, 1, 2, 3]


@pytest.mark.parametrize(("beats", "troubles"), [(100.0, 1), (1000.0, 0)])
def test_a_silence_that_no_call_told_is_trouble(beats, troubles):
    """A connection that hung for 10 s and ended well: others may have been cut off as long."""
    settings = dataclasses.replace(IMPATIENT, heartbeat_s=0.05, beats=beats)
    retries, beaten = workers._Retries("x", settings), itertools.count()
    enough = threading.Event()

    class Fill:
        def beat(self):
            k = next(beaten)
            if k == 1:
                retries.beaten -= 10.0
            if k == 3:
                enough.set()

    with workers._heartbeats([Fill()], retries, settings):
        assert enough.wait(10)
    assert retries.troubles == troubles


# ---- many workers, on PostgreSQL -----------------------------------------------------------------


@pytest.mark.slow
def test_two_workers_take_at_most_six_tenths_of_the_time_of_one(new_database, tmp_path):
    seconds = {}
    for count in (1, 2):
        url, log = new_database(), tmp_path / f"log{count}"
        finish(start(url, log, count, evaluations=16, pause=1.0))
        check(url, 16)
        ends = [float(x[1]) for x in lines(log, "end")]
        assert len(ends) == 16
        assert len({x[0] for x in lines(log, "end")}) == count
        seconds[count] = max(ends) - min(float(x[1]) for x in lines(log, "begin"))
    print(f"one worker {seconds[1]:.1f} s, two {seconds[2]:.1f} s")
    assert seconds[2] <= 0.6 * seconds[1]


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_only_its_running_batch(database, tmp_path):
    log = tmp_path / "log"
    options = {"evaluations": 12, "batch": 2, "pause": 1.0}
    (victim,) = start(database, log, **options)
    wait_for(log, "begin", 6)  # in the middle of its third batch
    victim.kill()
    victim.join()
    done = {tuple(x[2:]) for x in lines(log, "end")}
    assert len(done) == 4
    lost = {tuple(x[2:]) for x in lines(log, "begin")} - done
    finish(start(database, log, **options))
    everything = check(database, 12)
    assert sum(t.state == TrialState.FAIL and not t.user_attrs for t in everything) == 2
    again = [tuple(x[2:]) for x in lines(log, "end") if x[0] != str(victim.pid)]
    assert lost <= set(again), "another worker has taken the batch"
    assert len(again) == 8
    assert not done & set(again), "what was told is not evaluated again"


@pytest.mark.slow
def test_a_trial_that_never_gave_a_sign_of_life_is_taken_over(database, tmp_path):
    """Its worker died between making it and its first heartbeat, which Optuna never notices."""
    s = search(database, "random", settings=IMPATIENT)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dead = s.record.study.ask(SPACE)
    finish(start(database, tmp_path / "log", evaluations=3, pause=0.1))
    check(database, 3)
    assert s.record.trials[0].params == dead.params


@pytest.mark.slow
def test_a_database_that_goes_away_stops_nothing(server, database, tmp_path):
    """Cut off in the middle of evaluations, for longer than a trial may be silent."""
    log = tmp_path / "log"
    workers = start(database, log, 2, evaluations=24, batch=2, pause=0.7)
    wait_for(log, "begin", 6)
    server.stop()
    time.sleep(IMPATIENT.grace_s + 2)
    server.start()
    finish(workers)
    check(database, 24)
    assert len(lines(log, "end")) == 24, "nothing was evaluated again"
    said = [x[2] for x in lines(log, "said")]
    assert any("does not answer: waiting for it" in x for x in said)
    assert any("answers again after" in x for x in said)
    assert not any("gr4vel" in x for x in said)


@pytest.mark.slow
def test_whatever_dies_a_grid_is_full_in_the_end(server, database, tmp_path):
    """Three workers, killed at random and replaced, and a server that is cut off twice."""
    log, moments = tmp_path / "log", random.Random(3)
    options = {"names": ("grid", "cmaes", "nsga2"), "evaluations": 16, "batch": 2, "pause": 0.3}
    workers = start(database, log, 3, **options)
    for k in range(8):
        time.sleep(moments.uniform(0.2, 1.5))
        victim = moments.randrange(3)
        workers[victim].kill()
        workers[victim].join()
        workers[victim] = start(database, log, **options)[0]
        if k in (2, 5):
            server.stop()
            time.sleep(1.0)
            server.start()
    for process in workers:
        process.join(240)
    if any(process.exitcode for process in workers):  # one that began while the server was away
        finish(start(database, log, **options))
    for name in ("cmaes", "nsga2"):
        check(database, 16, name)
    check(database, 16, "grid")
    found = record.Record(database, "small-grid", about=ABOUT, settings=IMPATIENT).trials
    cells = sorted(tuple(t.params.values()) for t in found)
    assert cells == sorted(itertools.product(*grid(SPACE, 4).values()))


@pytest.mark.slow
def test_many_may_begin_at_once_on_an_empty_database(new_database, tmp_path):
    url = new_database(tables=False)
    finish(start(url, tmp_path / "log", 4, evaluations=8, pause=0.1))
    check(url, 8)


@pytest.mark.slow
def test_a_shared_study_of_another_robot_is_refused(server, database):
    workers.run([search(database, "random", evaluations=2, settings=IMPATIENT)], evaluate)
    with pytest.raises(StictionError, match="is of robot small: expected iiwa7"):
        search(database, "random", about={**ABOUT, "robot": "iiwa7"}, settings=IMPATIENT)
    with pytest.raises(StictionError, match="password authentication failed") as caught:
        search(server.url("wr0ng"), "random", settings=IMPATIENT)
    assert "wr0ng" not in str(caught.value)
    with pytest.raises(StictionError, match='database "nix" does not exist'):
        search(server.url(name="nix"), "random", settings=IMPATIENT)


@pytest.mark.slow
def test_a_database_that_stays_away_ends_the_worker(server, database):
    settings = IMPATIENT.__class__(**{**vars(IMPATIENT), "give_up_s": 1.0})
    s = search(database, "random", evaluations=4, settings=settings)

    def cut_off(wanted):
        server.stop()
        return evaluate(wanted)

    try:
        with (
            pytest.warns(UserWarning, match="does not answer"),
            pytest.raises(ExperimentError, match="run the same command again to go on"),
        ):
            workers.run([s], cut_off)
    finally:
        server.start()
    workers.run([search(database, "random", evaluations=4, settings=IMPATIENT)], evaluate)
    check(database, 4)


@pytest.mark.slow
def test_machines_run_the_thesis_protocol_together(database, small_arm, tmp_path):
    """Both end with every file, and those are the files of one that was alone."""
    model = str(tmp_path / "small.xml")
    alone = f"sqlite:///{tmp_path}/alone.db"
    jobs = [(alone, "alone"), (database, "a"), (database, "b")]
    finish([launch(tune_small, model, place, tmp_path / name) for place, name in jobs], 300)
    for name in ("base", "frequency", "scale", "intermediate", "final", "verification"):
        texts = {(tmp_path / job / f"{name}.csv").read_text() for _, job in jobs}
        assert len(texts) == 1, name
    found = {
        study: optuna.load_study(study_name=study, storage=open_storage(database)).get_trials()
        for study in optuna.get_all_study_names(open_storage(database))
    }
    assert {k: sum(t.state == TrialState.COMPLETE for t in v) for k, v in found.items()} == {
        "small-base": 2,
        "small-joint1": 6,
        "small-joint2": 6,
        "small-verification": 4,
    }
