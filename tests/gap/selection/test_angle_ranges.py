"""Judged by angles that were left out: what is real holds there, what only repeats does not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.selection.angle_ranges import AngleRanges, holds_over_angle
from stiction_envs.gap.selection.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.selection.chooser import Chooser
from stiction_envs.gap.selection.gain import gain
from stiction_envs.gap.signals.dataset import Data
from tests.gap.small_logs import data_of, hidden, panda, with_torque

BY_NAME = {c.name: c for c in CAUSES}
JOINT = 3
SMOOTH = "position_dependent_torque"
FEW = ("coulomb_friction", "torque_offset", "external_spring", SMOOTH, "base_tilt")


@cache
def moved() -> Data:
    return data_of(panda(), hidden(panda(), seconds=30.0, noise=0.05))


@pytest.fixture(scope="module")
def data() -> Data:
    return moved()


def library_of(data: Data, torque: np.ndarray, *names: str) -> RegressorLibrary:
    """Return the candidates of logs with a torque (T,) more on one joint."""
    more = np.zeros_like(data.q)
    more[:, JOINT] = torque
    return RegressorLibrary(with_torque(data, more), [BY_NAME[x] for x in names or FEW])


def hump(data: Data) -> np.ndarray:
    """A Gaussian of 1 N·m, 50 degrees wide."""
    x = (data.q[:, JOINT] - data.q[:, JOINT].mean() - 0.1) / 0.37
    return np.exp(-0.5 * x**2)


def smooth(order: int) -> Candidate:
    q = moved().q[:, JOINT]
    return Candidate(SMOOTH, JOINT, (float(order), float(q.min()), float(q.max())))


def test_a_hump_holds_at_angles_that_were_left_out(data: Data) -> None:
    library = library_of(data, hump(data))
    before, after, slope = AngleRanges(library, [smooth(2)], smooth(2)).with_and_without(smooth(2))
    assert after.sum() < 0.3 * before.sum()
    assert slope > 5
    assert {t.cause for t in Chooser(library).choose()} == {SMOOTH}


def test_a_torque_that_only_repeats_does_not_hold(data: Data) -> None:
    """The trap: blocks of time see the same angles again, and like any curve through them."""
    q = data.q[:, JOINT]
    library = library_of(data, 0.2 * np.sin(11 * q))
    repeats = [t for t in library.candidates if t.cause == SMOOTH and t.joint == JOINT]
    liked = [t for t in repeats if gain(library, [t], [t]).significant]
    assert liked
    assert not any(holds_over_angle(library, [t], t) for t in liked)
    assert SMOOTH not in {t.cause for t in Chooser(library).choose()}


def test_an_order_must_predict_more_than_a_lower_one(data: Data) -> None:
    q = data.q[:, JOINT]
    first = library_of(data, 1.5 * np.cos(q + 2.0))
    both = library_of(data, 1.5 * np.cos(q + 2.0) - 0.8 * np.sin(2 * q + 1.0))
    assert [holds_over_angle(first, [smooth(k)], smooth(k)) for k in (1, 2)] == [True, False]
    assert holds_over_angle(both, [smooth(2)], smooth(2))
    assert Chooser(first).choose() == [smooth(1)]
    assert Chooser(both).choose() == [smooth(2)]


def test_a_straight_pull_is_a_spring(data: Data) -> None:
    library = library_of(data, 2.0 * (data.q[:, JOINT] + 1.0))
    assert gain(library, [smooth(1)], [smooth(1)]).significant
    assert not holds_over_angle(library, [smooth(1)], smooth(1))
    assert {t.cause for t in Chooser(library).choose()} == {"external_spring"}
    # which must be among the hypotheses to be preferred
    without = library_of(data, 2.0 * (data.q[:, JOINT] + 1.0), SMOOTH)
    assert holds_over_angle(without, [smooth(1)], smooth(1))
