"""Small errors of the set-up: in the model where the logs ask for them, and never named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.causes import TOLERANCES, cause_named
from stiction_envs.gap.selection.candidates import RegressorLibrary
from stiction_envs.gap.selection.whole_models import with_set_up
from tests.gap.small_logs import data_of, hidden, panda, sliding

CAUSES = [TOLERANCES, *(cause_named(x) for x in ("torque_offset", "torque_scale"))]
OFFSETS = np.array([0.3, -0.2, 0.25, -0.3, 0.02, -0.03, 0.04])
"""Below a hundredth of the torque limits [N·m]."""


def library_of(offsets: np.ndarray) -> RegressorLibrary:
    log = hidden(panda(), noise=0.02)
    library = RegressorLibrary(data_of(panda(), replace(log, tau=log.tau + offsets)), CAUSES)
    return library.given(library.independent_rows * np.ones(7), 0.1)


@pytest.fixture(scope="module")
def library() -> RegressorLibrary:
    return library_of(OFFSETS)


def test_small_offsets_are_fitted_and_not_named(library) -> None:
    found = with_set_up(library, library.beside([]))
    assert found
    assert all(t.small for t in found)
    offsets = {
        t.joint: float(x[0])
        for t, x in zip(found, library.fitted(found), strict=True)
        if t.cause == "torque_offset"
    }
    # joint 1 turns about the vertical: nothing else there is constant
    assert offsets[0] == pytest.approx(OFFSETS[0], abs=0.02)
    grams = library.grams
    before, after = (
        grams.held_out(library.model_columns(x)).sum() for x in (library.beside([]), found)
    )
    assert after < before


def test_logs_without_small_errors_do_not_get_them() -> None:
    library = library_of(np.zeros(7))
    terms = library.beside([])
    assert with_set_up(library, terms) == terms


def test_small_dry_friction_is_fitted_and_not_named() -> None:
    """Half of what usual joints of this size have, on all of them; and without it, none."""
    true = 0.0025 * panda().limits.torque
    causes = [TOLERANCES, cause_named("coulomb_friction")]
    for size in (1.0, 0.0):
        log = hidden(panda(), lambda q, dq, ddq, size=size: size * true * sliding(q), noise=0.02)
        library = RegressorLibrary(data_of(panda(), log), causes)
        library.given(library.independent_rows * np.ones(7), 0.3)
        terms = library.beside([])
        found = with_set_up(library, terms)
        if not size:
            assert found == terms
            continue
        assert all(t.small for t in found)
        own = [t for t in found if t.cause == "coulomb_friction"]
        assert [t.joint for t in own] == list(range(7))
        fitted = dict(zip(found, library.fitted(found), strict=True))
        assert [float(fitted[t][0]) for t in own] == pytest.approx(true, rel=0.25)
