"""Scores and page of nested models, for models with known errors."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.thesis.nested_models.cells import JOINTS, cells, repeat_floor, score
from benchmarks.thesis.nested_models.fit import with_drift
from benchmarks.thesis.nested_models.models import NestedModels, lookup, nothing
from benchmarks.thesis.nested_models.page import page
from benchmarks.thesis.nested_models.scores import ModelScores

SHIPPED = Path(__file__).parents[3] / "benchmarks" / "thesis" / "nested_models"


@pytest.fixture(scope="module")
def all_cells():
    return cells()


@pytest.fixture(scope="module")
def models():
    return NestedModels(SHIPPED).models


@pytest.fixture(scope="module")
def measured(all_cells):
    return np.array([c.change for c in all_cells])


@pytest.fixture(scope="module")
def shipped(models, all_cells):
    return ModelScores(models, all_cells)


def changed(models, **changes) -> ModelScores:
    """Return the scores of models with other predictions."""
    new = {
        k: dataclasses.replace(models[k], change=np.asarray(v, dtype=float).tolist())
        for k, v in changes.items()
    }
    return ModelScores({**models, **new}, cells())


def parts(text: str) -> dict[str, str]:
    """Return a page by its headings."""
    return {p.partition("\n")[0]: p.rstrip() for p in re.split(r"(?m)^## ", text)}


# ---- models --------------------------------------------------------------------------------------


def test_models_without_physics_have_the_known_errors(all_cells):
    """About 14 % if dither does nothing, 5.3 % for the lookup, 3.1 / 1.7 % for the repeats."""
    assert score("nothing", all_cells, nothing(all_cells)).mean == pytest.approx(14, abs=0.5)
    assert score("lookup", all_cells, lookup(all_cells)).mean == pytest.approx(5.3, abs=0.05)
    mean, median = repeat_floor(all_cells)
    assert mean == pytest.approx(3.1, abs=0.05)
    assert median == pytest.approx(1.7, abs=0.1)


def test_drift_is_estimated_from_the_fitted_table_only(all_cells):
    """Held-out cells may say what they like: the factors stay."""
    rng = np.random.default_rng(0)
    predicted = np.where([c.held_out for c in all_cells], rng.normal(size=len(all_cells)), 0.0)
    seen = with_drift(all_cells, np.zeros(len(all_cells)))
    other = with_drift(all_cells, predicted)
    fitted = np.array([not c.held_out for c in all_cells])
    np.testing.assert_array_equal(seen[fitted], other[fitted])


def test_shipped_models_are_of_these_data_and_settings():
    assert set(ModelScores.CHAIN) < set(NestedModels(SHIPPED).models)
    assert NestedModels(SHIPPED, seeds=[0]).models == {}


# ---- page ----------------------------------------------------------------------------------------


def test_shipped_page_is_what_the_shipped_models_give(shipped):
    assert page(shipped).rstrip() == (SHIPPED / "gap.md").read_text("utf-8").rstrip()


# ---- scores --------------------------------------------------------------------------------------


def test_a_cause_is_named_where_it_helps_and_only_there(models, all_cells, measured):
    """Presliding helps joint 7 alone, and spoils joint 5."""
    joint = np.array([c.row.joint for c in all_cells])
    before = np.array(models["inertia"].change)
    after = np.where(joint == 7, measured, np.where(joint == 5, before + 0.05, before))
    s = changed(models, presliding=after)
    found = {j: {g.key: g for g in s.gains(j)}["presliding"] for j in JOINTS}
    assert [j for j in JOINTS if found[j].named] == [7]
    assert [j for j in JOINTS if found[j].worse] == [5]
