"""Columns of all causes: what they are given, what they sum up to."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES, Cause
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.signals.dataset import Data
from tests.gap.small_logs import data_of, hidden, panda, sliding

DRY, VISCOUS = (Candidate(f"{name}_friction", 3, ()) for name in ("coulomb", "viscous"))
OFFSET, PAYLOAD = Candidate("torque_offset", 5, ()), Candidate("payload", ARM, (0.0, 0.0, 0.0))
LINEAR = ("coulomb_friction", "viscous_friction", "torque_offset")


def causes(*names: str) -> list[Cause]:
    return [c for c in CAUSES if c.name in names]


@pytest.fixture(scope="module")
def data() -> Data:
    """Dry friction of 1 N·m in joint 4, an offset of 0.5 N·m in joint 6, noise of 0.01 N·m."""
    level, offset = np.zeros(7), np.zeros(7)
    level[3], offset[5] = 1.0, 0.5
    return data_of(panda(), hidden(panda(), lambda q, dq, ddq: sliding(q) * level + offset))


@pytest.fixture(scope="module")
def library(data: Data) -> RegressorLibrary:
    return RegressorLibrary(data, causes(*LINEAR, "payload"))


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


# ---- a refit given a payload or a tilt -----------------------------------------------------------


def carrying(data: Data) -> Data:
    """The same logs, given a load of a tenth of the arm's own and a tilt."""
    return data.carrying(0.1 * data.rigid, (0.3, 0.1, -9.8))


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
