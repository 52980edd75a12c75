"""The record of a search: the same bits, however often its process is killed."""

import itertools
import random

import numpy as np
import optuna
import pytest

from tests.refusal import refusal
from tests.tuning.study.searches import (
    ABOUT,
    evaluate,
    fill_slowly,
    launch,
    outcome,
    search,
    trials,
)
from tuning.names import SAMPLERS
from tuning.study.record import Record, run


class Killed(BaseException):
    """Replaces the end of the process."""


def stop_at(monkeypatch, count):
    """Let the process end before a trial is written, when ``count`` are."""
    add, left = Record.add, [count]

    def stopping(self, trial):
        if left[0] == 0:
            raise Killed
        left[0] -= 1
        add(self, trial)

    monkeypatch.setattr(Record, "add", stopping)


@pytest.mark.parametrize(
    "name",
    # opening SQLite takes half a second
    [pytest.param(n, marks=() if n == "cmaes" else pytest.mark.slow) for n in SAMPLERS],
)
def test_stopped_anywhere_it_goes_on_to_the_same_bits(name, tmp_path, monkeypatch):
    """Ten trials in batches of three, stopped after one, two, one, two … more are written."""
    whole = search("sqlite://", name)
    run([whole], evaluate)
    assert len(whole.record.trials) == 10
    place = f"sqlite:///{tmp_path}/study.db"
    stops = 0
    while len(search(place, name).record.trials) < 10:
        with monkeypatch.context() as patch:
            stop_at(patch, 1 + stops % 2)
            stops += 1
            try:
                run([search(place, name)], evaluate)
            except Killed:
                continue
    assert stops == 7
    assert trials(search(place, name).record) == trials(whole.record)
    run([search(place, name)], lambda wanted: pytest.fail("a finished study was evaluated"))


@pytest.mark.parametrize("name", SAMPLERS)
def test_draws_come_from_the_number_and_the_seed(name):
    found = []
    for seed in (0, 0, 1):
        found.append(search("sqlite://", name, seed=seed, evaluations=5))
        run(found[-1:], evaluate)
    first, same, other = (trials(s.record) for s in found)
    assert first == same
    assert first != other
    settings = [tuple(t.params.items()) for t in found[0].record.trials]
    assert len(set(settings)) == 5, "a setting was proposed twice"


def test_a_grid_has_every_cell_once():
    s = search("sqlite://", "grid", evaluations=16)
    run([s], evaluate)
    tried = [tuple(t.params.values()) for t in s.record.trials]
    every = itertools.product(np.linspace(0.5, 2.0, 4), np.geomspace(15.0, 80.0, 4))
    np.testing.assert_allclose(sorted(tried), sorted(every))
    assert tried != sorted(tried)


def test_what_cannot_be_measured_is_kept_as_a_failed_trial():
    s = search("sqlite://", "random", evaluations=20)
    run([s], evaluate)
    found = s.record.trials
    failed = [t for t in found if t.state == optuna.trial.TrialState.FAIL]
    assert 0 < len(failed) < 20
    for t in found:
        kept = outcome(t.params)
        assert t.values == (None if kept.values is None else list(kept.values))
        assert t.user_attrs["constraints"] == list(kept.constraints)
        assert t.user_attrs["swing_mm"] == kept.measures["swing_mm"]


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ({"robot": "iiwa7", "version": "2"}, "was made with another robot, version: expected the"),
        ({"bounds": [0.0, 3.0]}, "was made with another bounds: expected the same, or another"),
    ],
)
def test_a_study_about_something_else_is_refused(about, message, tmp_path):
    file = tmp_path / "study.db"
    place = f"sqlite:///{file}"
    run([search(place, "random", evaluations=3)], evaluate)
    before = file.read_bytes()
    refusal(lambda: search(place, "random", about={**ABOUT, **about}), message)
    assert file.read_bytes() == before


def test_a_second_process_does_not_fill_the_same_study(tmp_path):
    place = f"sqlite:///{tmp_path}/study.db"

    def again(wanted):
        refusal(lambda: run([search(place, "tpe")], evaluate), "another process is filling it")
        return evaluate(wanted)

    run([search(place, "random", evaluations=3)], again)
    run([search(place, "tpe", evaluations=3)], evaluate)


@pytest.mark.slow
def test_killed_at_twenty_random_moments_it_gives_the_same_trials(tmp_path):
    """kill −9 of a real process that fills a study per sampler; nothing is cleaned up."""
    whole = [search("sqlite://", name, evaluations=15) for name in SAMPLERS]
    run(whole, evaluate)
    moments, kills = random.Random(7), 0
    while kills < 20:
        place, exitcode = f"sqlite:///{tmp_path}/torn{kills}.db", None
        while exitcode != 0:
            process = launch(fill_slowly, place)
            process.join(moments.uniform(0.05, 0.9) if kills < 20 else None)
            process.kill()
            process.join()
            exitcode = process.exitcode
            kills += exitcode != 0  # it may end by itself, if only as the signal comes
        for one in whole:
            found = search(place, one.record.name.removeprefix("small-"))
            assert trials(found.record) == trials(one.record)
