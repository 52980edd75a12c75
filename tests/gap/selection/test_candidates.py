"""Columns of all causes: what they are given, what they sum up to."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES, Cause, Parameter
from stiction_envs.gap.linear.grams import Gram
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.signals.dataset import Data
from tests.gap.small_logs import data_of, hidden, panda, sliding, with_torque

DRY, VISCOUS = (Candidate(f"{name}_friction", 3, ()) for name in ("coulomb", "viscous"))
OFFSET, PAYLOAD = Candidate("torque_offset", 5, ()), Candidate("payload", ARM, (0.0, 0.0, 0.0))
LINEAR = ("coulomb_friction", "viscous_friction", "torque_offset")


def causes(*names: str) -> list[Cause]:
    return [c for c in CAUSES if c.name in names]


class Asked(Cause):
    """Remembers the residuals that its nonlinear parameters are chosen by."""

    name, what, what_to_record, parameters = "asked", "", "", ()

    def __init__(self) -> None:
        self.residuals: dict[int, np.ndarray] = {}

    def shapes(self, data, joint, residual):
        self.residuals[joint] = residual
        return []

    def columns(self, data, joint, shape):
        raise NotImplementedError


class Twist(Cause):
    """A cause of one joint that all joints' torques show, each by another share."""

    name, what, what_to_record = "twist", "", ""
    parameters = (Parameter("twist_nm", "N·m"),)
    coupled = True

    def spread(self, data, joint, shape):
        share = np.roll(np.arange(1.0, data.n + 1), joint)
        return data.q[:, [joint], None] * share[:, None]

    def columns(self, data, joint, shape):
        raise NotImplementedError


@pytest.fixture(scope="module")
def data() -> Data:
    """Dry friction of 1 N·m in joint 4, an offset of 0.5 N·m in joint 6, noise of 0.01 N·m."""
    level, offset = np.zeros(7), np.zeros(7)
    level[3], offset[5] = 1.0, 0.5
    return data_of(panda(), hidden(panda(), lambda q, dq, ddq: sliding(q) * level + offset))


@pytest.fixture(scope="module")
def library(data: Data) -> RegressorLibrary:
    return RegressorLibrary(data, causes(*LINEAR, "payload"))


def test_nonlinear_causes_see_what_linear_ones_leave(data: Data) -> None:
    asked = Asked()
    RegressorLibrary(data, [*causes(*LINEAR), asked])
    for joint in (3, 5):
        seen, all_of_it = (np.std(x) for x in (asked.residuals[joint], data.residual[:, joint]))
        assert seen < (0.2 * all_of_it if joint == 3 else 1.1 * all_of_it)
        assert abs(asked.residuals[joint].mean()) < 0.02


def test_what_no_cause_explains_weighs_less(data: Data) -> None:
    """Bumps of 20 N·m count little, though friction is larger; ordinary rows count in full."""
    torque = np.zeros_like(data.q)
    hit = np.arange(len(data.t)) % 1000 < 10
    (dry,) = causes("coulomb_friction")
    torque[:, 3] = 20.0 * hit + 30.0 * dry.columns(data, 3, ())[:, 0]
    weight = RegressorLibrary(with_torque(data, torque), causes(*LINEAR)).weight[:, 3]
    assert weight.max() == 1.0
    assert weight[hit].max() < 0.1
    assert weight[~hit].mean() > 0.9


def test_errors_are_in_units_of_the_noise(library: RegressorLibrary) -> None:
    """With everything that is hidden in the model, one per row and joint; a payload is none."""
    left = library.grams.errors(library.model_columns([DRY, OFFSET]))
    rows = np.array([g.count.sum() for g in library.grams.joints])
    assert np.all((left / rows > 0.3) & (left / rows < 2.0))
    assert library.grams.errors(library.model_columns([OFFSET]))[3] > 100 * left[3]


@pytest.mark.parametrize("terms", [[DRY, OFFSET], [OFFSET, PAYLOAD, DRY, VISCOUS]])
def test_models_are_fits_to_their_columns(library: RegressorLibrary, terms) -> None:
    """Law checked: what the fit leaves of the residual, row by row, is what the sums say."""
    model = library.model_columns(terms)
    c = library.grams.fit(model)
    inside = library.data.block >= 0
    for joint, errors in enumerate(library.grams.errors(model)):
        e = (library.residual[:, joint] - library.torque(terms, c, joint))[inside]
        weight = library.weight[inside, joint] / library.data.noise[joint] ** 2
        assert errors == pytest.approx((weight * e * e).sum(), rel=1e-5)
    np.testing.assert_array_equal(
        library.own(terms, [DRY]), [t is DRY for t in terms for _ in range(1 + 9 * (t is PAYLOAD))]
    )


def test_affected_joints(library: RegressorLibrary) -> None:
    assert library.affected_joints(DRY) == [3]
    assert library.affected_joints(PAYLOAD) == list(range(7))


def test_a_coupled_cause_has_one_coefficient_in_all_torques(data: Data) -> None:
    twist, terms = Twist(), [Candidate("twist", j, ()) for j in (1, 2)]
    torque = np.einsum("tnk->tn", 0.3 * twist.spread(data, 1, ()) - twist.spread(data, 2, ()))
    library = RegressorLibrary(with_torque(data, torque), [*causes(*LINEAR), twist])
    assert library.affected_joints(terms[0]) == list(range(7))
    c = library.grams.fit(library.model_columns([*terms, DRY, OFFSET]))
    np.testing.assert_allclose(c[:2], [0.3, -1.0], atol=0.01)
    single = np.finfo(np.float32).eps * np.abs(torque).max()  # as columns are kept
    for j in range(7):
        found = library.torque(terms, np.array([0.3, -1.0]), j)
        np.testing.assert_allclose(found, torque[:, j], rtol=0, atol=single)


def test_columns_that_come_later_sum_up_as_if_they_had_been_there(data: Data) -> None:
    names = ("coulomb_friction", "actuator_delay", "stribeck_friction")
    names = (*names, "position_dependent_torque", "link_parameters", "payload")
    later = [Candidate("stribeck_friction", 3, (x,)) for x in (0.07, 0.11)]
    later.append(Candidate("actuator_delay", ARM, (0.003,)))
    library = RegressorLibrary(data, causes(*names))
    for term in later:
        library.refine([term])
    for j, gram in enumerate(library.grams.joints):
        terms = [t for t in library.candidates if j in library.affected_joints(t)]
        x = np.concatenate([library.columns(t, j) for t in terms], axis=1)
        weight = library.weight[:, j] / data.noise[j] ** 2
        whole = Gram.of(x, data.residual[:, j], data.block, weight, data.blocks)
        assert np.allclose(gram.xx, whole.xx, rtol=1e-9, atol=1e-9 * np.abs(whole.xx).max())
        assert np.allclose(gram.xr, whole.xr, rtol=1e-9, atol=1e-9 * np.abs(whole.xr).max())


# ---- a refit given a payload or a tilt -----------------------------------------------------------


def carrying(data: Data) -> Data:
    """The same logs, given a load of a tenth of the arm's own and a tilt."""
    return data.carrying(0.1 * data.rigid, (0.3, 0.1, -9.8))


@pytest.mark.parametrize("name", [c.name for c in CAUSES if not c.depends_on_load])
def test_what_does_not_depend_on_the_load_is_the_same_given_one(data: Data, name: str) -> None:
    (cause,), given = causes(name), carrying(data)
    reasons = [cause.why_not_identifiable(x, 3) for x in (data, given)]
    shapes = [cause.shapes(x, 3, x.residual[:, 3]) for x in (data, given)]
    assert reasons[0] == reasons[1]
    assert shapes[0] == shapes[1]
    for shape in shapes[0]:
        one, two = (cause.columns(x, 3, shape) for x in (data, given))
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("change", [carrying, lambda data: data.with_presliding(np.full(7, 1e-3))])
def test_a_library_that_takes_columns_of_another_is_that_made_anew(data: Data, change) -> None:
    names = (*LINEAR, "payload", "load_dependent_friction", "stribeck_friction", "warm_up_drift")
    mine, given = causes(*names), change(data)
    before = RegressorLibrary(data, mine)
    before.refine([Candidate("stribeck_friction", 3, (0.123,))])
    taken = RegressorLibrary(given, mine, instead_of=before)
    anew = RegressorLibrary(given, mine)
    assert taken.candidates == anew.candidates
    assert taken.not_identifiable == anew.not_identifiable
    assert list(taken.not_identifiable) == list(anew.not_identifiable)
    for one, two in zip(taken.grams.joints, anew.grams.joints, strict=True):
        np.testing.assert_array_equal(one.xx, two.xx)
        np.testing.assert_array_equal(one.xr, two.xr)
    for term in anew.candidates:
        joint = anew.affected_joints(term)[0]
        np.testing.assert_array_equal(taken.columns(term, joint), anew.columns(term, joint))


def test_columns_are_taken_and_not_computed_again(data: Data) -> None:
    asked = Asked()
    asked.depends_on_load = False
    before = RegressorLibrary(data, [*causes(*LINEAR), asked])
    asked.residuals.clear()
    RegressorLibrary(carrying(data), [*causes(*LINEAR), asked], instead_of=before)
    assert asked.residuals == {}
