"""Choosing: what is barred stays out, what is not significant goes, what it kept out comes in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from stiction_envs.gap.causes import CAUSES, Cause, Parameter
from stiction_envs.gap.linear.grams import t_statistic
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.selection.chooser import Chooser, Offer
from stiction_envs.gap.selection.gain import Gain, gain, is_implausible, is_significant, pruned
from stiction_envs.gap.selection.refit import refine_delay
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


def test_excluded_causes_are_not_tried(library: RegressorLibrary) -> None:
    chosen = Chooser(library, None, [OFFSET], [DRY]).choose()
    assert DRY not in chosen
    assert chosen[0] == OFFSET
    # viscous friction is what resembles it most
    assert Candidate("viscous_friction", 3, ()) in chosen


def test_insignificant_terms_are_pruned(library: RegressorLibrary) -> None:
    nothing = [Candidate("viscous_friction", 0, ()), Candidate("torque_offset", 1, ())]
    assert pruned(library, [nothing[0], DRY, nothing[1], OFFSET]) == [DRY, OFFSET]


def test_gains_of_terms_on_different_joints_add_up(library: RegressorLibrary) -> None:
    both = gain(library, [DRY, OFFSET], [DRY, OFFSET])
    each = [gain(library, [x], [x]) for x in (DRY, OFFSET)]
    assert both.significant
    assert both.total == pytest.approx(sum(x.total for x in each), rel=1e-6)


def test_without_a_delay_nothing_is_refined(library: RegressorLibrary) -> None:
    assert refine_delay(library, [DRY, OFFSET]) == [DRY, OFFSET]


# ---- what is significant -------------------------------------------------------------------


def test_a_gain_must_be_there_on_a_joint_and_as_a_whole() -> None:
    def judged(less: float, joint: bool, whole: bool) -> bool:
        return Gain(np.full((1, 4), less), np.array([joint]), whole).significant

    assert judged(1.0, True, True)
    assert not judged(-1.0, True, True)
    assert not judged(1.0, False, True)
    assert not judged(1.0, True, False)


def test_with_equal_blocks_the_slope_is_students_t() -> None:
    """Law checked: t of the mean of pᵀe over its standard error, in any unit; none without p."""
    rng = np.random.default_rng(0)
    came = rng.normal(1.0, 0.5, 12)
    for size in (1e-3, 1.0, 1e3):
        found = t_statistic(size * came, np.full(12, size))
        assert found == pytest.approx(ttest_1samp(came, 0.0).statistic)
    assert t_statistic(np.zeros(12), np.zeros(12)) <= 0.0
    assert t_statistic(np.ones(1), np.ones(1)) <= 0.0


def test_an_offset_is_seen_beside_any_exact_torque_but_not_beside_rough_friction(library) -> None:
    """0.1 N·m beside 3 N·m: the law of viscous friction is exact, that of dry friction is not."""
    offset = Candidate("torque_offset", 3, ())
    exact = with_causes(library, *FEW, viscous_friction=10.0, torque_offset=0.1)
    rough = with_causes(library, *FEW, coulomb_friction=5.0, torque_offset=0.1)
    assert gain(exact, [VISCOUS, DRY, offset], [offset]).significant
    assert not gain(rough, [DRY, offset], [offset]).significant
    assert gain(rough, [DRY, offset], [DRY]).significant


@pytest.mark.parametrize(("size", "found"), [(0.8, False), (1.5, True)])
def test_what_is_left_within_the_noise_floor_is_not_explained(size, found) -> None:
    """However well it would be: noise of the acceleration is in columns and residuals alike."""
    data = data_of(panda(), hidden(panda()))
    data = replace(data, noise=5 * data.noise)
    torque = np.zeros_like(data.q)
    torque[:, 5] = size * data.noise[5]
    library = RegressorLibrary(with_torque(data, torque), [BY_NAME["torque_offset"]])
    judged = gain(library, [OFFSET], [OFFSET])
    assert judged.significant == found
    assert library.grams.gained(*(library.model_columns(x) for x in ([OFFSET], [])))[5] > 0.5


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


def offer(added: list[Candidate], less: np.ndarray) -> Offer:
    return Offer(added, Gain(less, np.ones(len(less), dtype=bool), True))


def test_the_simplest_of_what_is_as_good(library: RegressorLibrary) -> None:
    """1 % less is as good; 5 % only where it is within two errors from block to block."""
    chooser, blocks = Chooser(library), 12
    even, uneven = np.full((2, blocks), 1.0), np.full((2, blocks), 1.0)
    uneven[0, 0], uneven[0, 1] = 12.0, -10.0
    # the gains on two joints differ, which says nothing of blocks
    even[0], even[1] = 1.5, 0.5
    best = offer([DRY, VISCOUS], even)

    def chosen(lost: float, shape: np.ndarray) -> Offer | None:
        other = offer([DRY], even - lost * even.sum() * shape / shape.sum())
        worse = offer([VISCOUS], 0.999 * other.found.less)
        found = chooser._simplest([worse, best, other])
        assert found in (best, other)
        return found

    joint = np.zeros((2, blocks))
    joint[0] = 1.0
    assert chosen(0.009, even) is not best
    assert chosen(0.03, even) is best
    assert chosen(0.03, joint) is best
    assert chosen(0.03, uneven) is not best
    assert chosen(0.06, uneven) is best
    assert chooser._simplest([]) is None


def test_the_whole_arm_is_held_against_the_sum_over_joints(library: RegressorLibrary) -> None:
    """A cause of single joints comes first where all its joints together gain more."""
    less = np.ones((7, 12)) / 84
    arm = offer([Candidate("payload", ARM, (0.0, 0.0, 0.0))], 100.0 * less)
    friction = [offer([Candidate("coulomb_friction", j, ())], 50.5 * less) for j in range(2)]
    # counted by the cause itself, not by what it needs
    fading = offer([DRY, Candidate("stribeck_friction", 3, (0.1,))], 99.0 * less)
    named = [BY_NAME[x] for x in (*FEW, "payload", "stribeck_friction")]
    chooser = Chooser(RegressorLibrary(library.data, named))
    assert chooser._leading([arm, *friction, fading]) == friction
    assert chooser._leading([arm, friction[0], fading]) == [arm, friction[0], fading]
    assert chooser._leading([*friction, fading]) == [*friction, fading]
    other = offer([Candidate("coulomb_friction", 1, ())], 49.8 * less)
    assert chooser._leading([arm, friction[0], other]) == [friction[0], other]


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


@pytest.mark.parametrize(("other", "found"), [(1.0, False), (1e-3, True)])
def test_a_cause_of_the_arm_must_not_spoil_other_joints(other, found) -> None:
    """Half of one joint's torque is taken away, and as much put on one that had none."""
    data = data_of(gyro(), hidden(gyro()))
    whole = Made("whole", data.q * [1.0, other], arm_wide=True)
    library = RegressorLibrary(with_torque(data, data.q * [1.0, 0.0]), [whole])
    judged = gain(library, [Candidate("whole", ARM, ())], [Candidate("whole", ARM, ())])
    assert judged.total > 0
    assert judged.significant_joints[0]
    assert judged.as_a_whole == judged.significant == found
    whole_arm = [Candidate("whole", ARM, ())]
    assert is_significant(library, whole_arm, whole_arm) == found


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
