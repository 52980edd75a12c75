"""Choosing: what is barred stays out, what is not significant goes, what it kept out comes in."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.candidates import Candidate, RegressorLibrary
from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.refit import settle
from stiction_envs.gap.selection import Chooser, gain, pruned
from tests.gap.small_logs import data_of, hidden, panda, sliding

DRY = Candidate("coulomb_friction", 3, ())
OFFSET = Candidate("torque_offset", 5, ())


@pytest.fixture(scope="module")
def library() -> RegressorLibrary:
    """Dry friction of 1 N·m in joint 4, an offset of 0.5 N·m in joint 6."""
    level, offset = np.zeros(7), np.zeros(7)
    level[3], offset[5] = 1.0, 0.5
    log = hidden(panda(), lambda q, dq, ddq: sliding(q) * level + offset)
    few = [c for c in CAUSES if c.name in ("coulomb_friction", "viscous_friction", "torque_offset")]
    return RegressorLibrary(data_of(panda(), log), few)


def test_what_is_hidden_is_chosen(library: RegressorLibrary) -> None:
    assert set(Chooser(library).choose()) == {DRY, OFFSET}


def test_what_is_barred_stays_out(library: RegressorLibrary) -> None:
    chosen = Chooser(library, None, [OFFSET], [DRY]).choose()
    assert DRY not in chosen
    assert chosen[0] == OFFSET
    # viscous friction is what resembles it most
    assert Candidate("viscous_friction", 3, ()) in chosen


def test_what_does_not_stand_is_pruned(library: RegressorLibrary) -> None:
    nothing = [Candidate("viscous_friction", 0, ()), Candidate("torque_offset", 1, ())]
    assert pruned(library, [nothing[0], DRY, nothing[1], OFFSET]) == [DRY, OFFSET]


def test_gains_of_terms_on_different_joints_add_up(library: RegressorLibrary) -> None:
    both = gain(library, [DRY, OFFSET], [DRY, OFFSET])
    each = [gain(library, [x], [x]) for x in (DRY, OFFSET)]
    assert both.significant
    assert both.total == pytest.approx(sum(x.total for x in each), rel=1e-6)


def test_without_a_delay_nothing_is_settled(library: RegressorLibrary) -> None:
    assert settle(library, [DRY, OFFSET]) == [DRY, OFFSET]
