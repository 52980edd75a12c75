"""Choosing: what is barred stays out, what is not significant goes, what it kept out comes in."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES, Cause, Parameter
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.selection.chooser import Chooser
from stiction_envs.gap.selection.gain import gain, is_implausible, is_significant, pruned
from tests.friction.gyro import gyro
from tests.gap.small_logs import data_of, hidden, panda, sliding, with_torque

DRY = Candidate("coulomb_friction", 3, ())
VISCOUS = Candidate("viscous_friction", 3, ())
OFFSET = Candidate("torque_offset", 5, ())
BY_NAME = {c.name: c for c in CAUSES}
FEW = ("coulomb_friction", "viscous_friction", "torque_offset")


@pytest.fixture(scope="module")
def library() -> RegressorLibrary:
    """Dry friction of 1 N·m in joint 4, an offset of 0.5 N·m in joint 6."""
    level, offset = np.zeros(7), np.zeros(7)
    level[3], offset[5] = 1.0, 0.5
    log = hidden(panda(), lambda q, dq, ddq: sliding(q) * level + offset)
    return RegressorLibrary(data_of(panda(), log), [BY_NAME[x] for x in FEW])


def with_causes(library: RegressorLibrary, *names: str, **torques: float) -> RegressorLibrary:
    """Return a library of causes, with so much of some on joint 4 beside what is hidden already."""
    more = np.zeros_like(library.data.q)
    for name, size in torques.items():
        more[:, 3] += size * BY_NAME[name].columns(library.data, 3, ())[:, 0]
    return RegressorLibrary(with_torque(library.data, more), [BY_NAME[x] for x in names])


def test_what_is_hidden_is_chosen_and_its_terms_are_counted(library: RegressorLibrary) -> None:
    steps: list[int] = []
    assert set(Chooser(library, steps.append).choose()) == {DRY, OFFSET}
    assert steps == [1, 2]


def test_insignificant_terms_are_pruned(library: RegressorLibrary) -> None:
    nothing = [Candidate("viscous_friction", 0, ()), Candidate("torque_offset", 1, ())]
    assert pruned(library, [nothing[0], DRY, nothing[1], OFFSET]) == [DRY, OFFSET]


# ---- what is significant -------------------------------------------------------------------


def test_an_offset_is_seen_beside_any_exact_torque_but_not_beside_rough_friction(library) -> None:
    """0.1 N·m beside 3 N·m: the law of viscous friction is exact, that of dry friction is not."""
    offset = Candidate("torque_offset", 3, ())
    exact = with_causes(library, *FEW, viscous_friction=10.0, torque_offset=0.1)
    rough = with_causes(library, *FEW, coulomb_friction=5.0, torque_offset=0.1)
    assert gain(exact, [VISCOUS, DRY, offset], [offset]).significant
    assert not gain(rough, [DRY, offset], [offset]).significant
    assert gain(rough, [DRY, offset], [DRY]).significant


def test_a_value_on_its_bound_is_implausible(library: RegressorLibrary) -> None:
    backwards = with_causes(library, *FEW, coulomb_friction=-2.0)
    assert is_implausible(backwards, [DRY, OFFSET], [DRY])
    assert not is_implausible(backwards, [DRY, OFFSET], [OFFSET])
    assert not is_implausible(library, [DRY, OFFSET], [DRY, OFFSET])


def test_a_cause_is_pruned_with_the_one_that_it_needs(library: RegressorLibrary) -> None:
    """Asymmetry of a joint without friction is none, however significant."""
    asymmetry = Candidate("direction_asymmetry", 3, ())
    both = {"coulomb_friction": -1.0, "direction_asymmetry": 0.5}
    only = with_causes(library, *FEW, "direction_asymmetry", **both)
    only.refine([asymmetry])  # by hand: a joint that never rests cannot show it
    assert gain(only, [asymmetry], [asymmetry]).significant
    assert pruned(only, [asymmetry]) == []
    with_friction = with_causes(library, *FEW, "direction_asymmetry", direction_asymmetry=0.5)
    with_friction.refine([asymmetry])
    assert pruned(with_friction, [DRY, asymmetry]) == [DRY, asymmetry]


# ---- which of what is significant ----------------------------------------------------------


# ---- term by term, with causes made for it -------------------------------------------------


class Made(Cause):
    """A cause of two joints, or of one, with columns that a test gives: (T, n)."""

    what = what_to_record = ""
    parameters = (Parameter("size", "N·m"),)

    def __init__(self, name: str, torque: np.ndarray, *, arm_wide: bool = False) -> None:
        self.name, self.arm_wide, self.torque = name, arm_wide, torque  # type: ignore[misc]

    def columns(self, data, joint, shape):
        return self.torque[:, [joint]]


@pytest.mark.parametrize("true", ["local", "whole"])
def test_what_was_significant_is_judged_anew_once_something_is_found(true) -> None:
    """Two causes that resemble each other, of a joint and of the arm: the true one alone comes."""
    data = data_of(gyro(), hidden(gyro()))
    local = Made("local", np.sin(2 * data.q))
    whole = Made("whole", data.q * [1.0, 0.02], arm_wide=True)
    torque = {"local": local.torque * [1.0, 0.0], "whole": whole.torque}[true]
    library = RegressorLibrary(with_torque(data, torque), [local, whole])
    other = {"local": Candidate("whole", ARM, ()), "whole": Candidate("local", 0, ())}[true]
    assert gain(library, [other], [other]).significant
    assert is_significant(library, [other], [other])
    steps: list[int] = []
    chosen = Chooser(library, steps.append).choose()
    assert chosen == [Candidate(true, 0 if true == "local" else ARM, ())]
    assert steps == [1]


@pytest.mark.parametrize(("size", "found"), [(1.5, False), (2.5, True)])
def test_pairs_are_tried_where_twice_the_noise_is_left(size, found) -> None:
    """Two columns that say something by their difference only."""
    data = data_of(gyro(), hidden(gyro()))
    x, y = (np.sin(2 * np.pi * f * data.t)[:, None] * [1.0, 0.0] for f in (0.37, 1.13))
    one, two = Made("one", x + 0.01 * y), Made("two", x)
    torque = np.sqrt(2) * np.sqrt(size**2 - 1) * data.noise[0] * y
    library = RegressorLibrary(with_torque(data, torque), [one, two])
    pair = [Candidate("one", 0, ()), Candidate("two", 0, ())]
    assert gain(library, pair, pair).significant
    assert not any(gain(library, [x], [x]).significant for x in pair)
    assert set(Chooser(library).choose()) == (set(pair) if found else set())


@pytest.mark.parametrize("start", [[], [DRY]])
def test_what_a_cause_needs_comes_with_it_once(library: RegressorLibrary, start) -> None:
    more = np.zeros_like(library.data.q)
    more[:, 3] = 2.0 * BY_NAME["stribeck_friction"].columns(library.data, 3, (0.1,))[:, 0]
    causes = [BY_NAME[x] for x in (*FEW, "stribeck_friction")]
    fading = RegressorLibrary(with_torque(library.data, more), causes)
    chosen = Chooser(fading, None, start).choose()
    assert sorted(t.cause for t in chosen if t.joint == 3)[:2] == [DRY.cause, "stribeck_friction"]
    assert len({(t.cause, t.joint) for t in chosen}) == len(chosen)
