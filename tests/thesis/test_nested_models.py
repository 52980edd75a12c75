"""Yardsticks of the nested models: known errors of those without physics, drift, scores."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.tables.cells import cells, repeat_floor, score
from stiction_envs.gap.tables.model import with_drift
from stiction_envs.thesis.nested_models import lookup, nothing


@pytest.fixture(scope="module")
def all_cells():
    return cells()


def test_cells(all_cells):
    assert len(all_cells) == 308
    assert sum(c.held_out for c in all_cells) == 196
    assert [(c.row.table, c.row.joint, c.row.frequency_hz) for c in all_cells if c.row.outlier] == [
        ("4.7", 2, 30.0)
    ]


def test_models_without_physics_have_the_known_errors(all_cells):
    """About 14 % if dither does nothing, 5.3 % for the lookup, 3.1 / 1.7 % for the repeats."""
    assert score("nothing", all_cells, nothing(all_cells)).mean == pytest.approx(14, abs=0.5)
    assert score("lookup", all_cells, lookup(all_cells)).mean == pytest.approx(5.3, abs=0.05)
    mean, median = repeat_floor(all_cells)
    assert mean == pytest.approx(3.1, abs=0.05)
    assert median == pytest.approx(1.7, abs=0.1)


def test_a_perfect_model_scores_zero_but_for_nothing_broken(all_cells):
    perfect = np.array([c.change for c in all_cells])
    s = score("perfect", all_cells, perfect)
    assert s.mean == s.high == s.median == 0.0
    assert len(s.broken) == 1


def test_drift_is_estimated_from_the_fitted_table_only(all_cells):
    """Held-out cells may say what they like: the factors stay."""
    rng = np.random.default_rng(0)
    predicted = np.where([c.held_out for c in all_cells], rng.normal(size=len(all_cells)), 0.0)
    seen = with_drift(all_cells, np.zeros(len(all_cells)))
    other = with_drift(all_cells, predicted)
    fitted = np.array([not c.held_out for c in all_cells])
    np.testing.assert_array_equal(seen[fitted], other[fitted])
