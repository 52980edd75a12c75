"""Threads that step batches: the same bits for any number of them, also where a batch fails."""

import signal
import threading
import time

import numpy as np
import pytest

from stiction_envs.envs.batches import Batches
from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.episodes import Outcome
from tests.envs.helpers import GTE, divided, same


class Core:
    """A batch that counts its steps; ``doing`` is called in each of them."""

    arms_per_batch = 2

    def __init__(self, num_envs: int, doing=lambda core: None, **_) -> None:
        self.num_envs, self.doing, self.count = num_envs, doing, 0

    def check_step(self, ids, action) -> None:
        pass

    def step(self, ids, action) -> Outcome:
        self.doing(self)
        self.count += 1
        of, no = np.full(len(ids), float(self.count)), np.zeros(len(ids), dtype=bool)
        return Outcome(terms={"count": of}, terminated=no, truncated=no, measures={})


def made(count: int, threads: int, doing) -> Batches:
    return Batches(Core, count, threads=threads, doing=doing)  # type: ignore[arg-type]


def stepped(found: Batches) -> np.ndarray:
    ids = np.arange(sum(c.num_envs for c in found.cores))
    return found.step(ids, np.zeros((len(ids), 1))).reward


def test_an_error_of_a_batch_is_raised_once_and_the_others_go_on():
    def fails(core) -> None:
        if core in (found.cores[1], found.cores[3]) and not core.failed:
            core.failed = True
            raise ExperimentError(f"batch {found.cores.index(core)}")

    found = made(9, 2, fails)
    for core in found.cores:
        core.failed = False
    with pytest.raises(ExperimentError, match=r"^batch 1$"):
        stepped(found)
    assert [c.count for c in found.cores] == [1, 0, 1, 0, 1, 1]
    stepped(found)
    assert [c.count for c in found.cores] == [2, 1, 2, 1, 2, 2]


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_waits_for_every_batch(threads):
    def interrupts(core) -> None:
        if core is found.cores[0]:
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        time.sleep(0.05)

    found = made(6, threads, interrupts)
    usual = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            stepped(found)
    finally:
        signal.signal(signal.SIGINT, usual)
    assert {c.count for c in found.cores} == {1}


def test_an_arm_that_the_engine_stops_harms_no_other_batch(monkeypatch):
    env, other = (divided(monkeypatch, GTE, 2, 4, threads=2) for _ in range(2))
    action = np.tile(env.single_action_space.low, (4, 1))
    for e in (env, other):
        e.reset(seed=1)
        e.step(action)
    env.unwrapped.batches.cores[0].rig.plant.state[0][1] = np.nan
    with pytest.raises(ExperimentError, match="simulation 1 stopped by the engine"):
        env.step(action)
    other.step(action)
    beside = np.arange(2, 4)
    for _ in range(2):
        seen = [e.unwrapped.batches.observe(beside) for e in (env, other)]
        assert same(*seen)
        steps = [e.unwrapped.batches.step(beside, action[2:]) for e in (env, other)]
        assert same(steps[0].measures, steps[1].measures)
