"""Work shared with a second process: the same results, in order, whatever happens to it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from functools import partial

import pytest

from stiction_envs.reporting.shared_work import shared


def with_process(k: int) -> tuple[int, int]:
    return k, os.getpid()


@pytest.fixture
def two_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr(threading, "active_count", lambda: 1)  # pytest's plugins have some


@pytest.mark.usefixtures("two_processors")
def test_half_of_the_jobs_are_done_elsewhere_and_come_back_in_order() -> None:
    found = shared([partial(with_process, k) for k in range(5)])
    assert [k for k, _ in found] == list(range(5))
    here = [pid == os.getpid() for _, pid in found]
    assert here == [True, False, True, False, True]


@pytest.mark.usefixtures("two_processors")
@pytest.mark.parametrize("threads", [1, 0])
def test_one_processor_does_all(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    if not threads:
        monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    found = shared([partial(with_process, k) for k in range(4)], threads)
    assert found == [(k, os.getpid()) for k in range(4)]


@pytest.mark.usefixtures("two_processors")
def test_what_fails_elsewhere_is_done_here() -> None:
    here = os.getpid()

    def only_here() -> str:
        assert os.getpid() == here
        return "done"

    def ends() -> int:
        if os.getpid() != here:
            os._exit(1)
        return os.getpid()

    jobs: list[Callable[[], object]] = [only_here, only_here]
    assert shared(jobs) == ["done", "done"]
    assert shared([ends, ends]) == [here, here]


@pytest.mark.usefixtures("two_processors")
def test_an_error_is_raised_as_it_is() -> None:
    def wrong() -> None:
        raise ValueError("no such joint")

    with pytest.raises(ValueError, match="no such joint"):
        shared([lambda: None, wrong])


def test_a_program_with_threads_is_not_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threading, "active_count", lambda: 2)
    assert {pid for _, pid in shared([partial(with_process, k) for k in range(4)])} == {os.getpid()}
