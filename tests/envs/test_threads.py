"""Threads share work: nothing is done twice or left out, and whoever is free helps."""

from __future__ import annotations

import threading
from functools import partial

import pytest

from stiction_envs.envs.threads import Threads


def test_a_thread_without_a_task_helps_with_what_another_shares():
    threads, together = Threads(2), threading.Barrier(2)

    def task() -> list[int]:
        return threads.share([partial(together.wait, 30) for _ in range(6)])

    (both,) = threads.run([task])
    assert sorted(both) == [0, 0, 0, 1, 1, 1], "two at a time"


def test_an_error_in_a_part_is_raised_by_its_task_when_all_parts_are_done():
    threads, done = Threads(2), []

    def part(k: int) -> None:
        if k == 1:
            raise ValueError("part 1")
        done.append(k)

    def task() -> None:
        threads.share([partial(part, k) for k in range(4)])

    with pytest.raises(ValueError, match="part 1"):
        threads.run([task, lambda: done.append(9)])
    assert sorted(done) == [0, 2, 3, 9]
    assert threads.run([lambda: 1]) == [1], "the threads go on"
