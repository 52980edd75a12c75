"""Small errors of all links: their size, their doubt, and what a next session makes of both."""

import numpy as np
import pytest

from stiction_envs.gap.causes import TOLERANCES, cause_named
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.links import LinkErrors, link_errors, root_of
from stiction_envs.gap.model_file import read
from stiction_envs.gap.predictors.torque import TorquePredictor
from stiction_envs.robots import Arm
from stiction_envs.robots.consistent import tolerances
from stiction_envs.robots.inertias import with_inertias
from stiction_envs.robots.regressor import consistent, inertial_parameters
from tests.gap.small_logs import data_of, hidden, panda, part, write_model

SIZE = 0.3
"""Size of the errors over the tolerance of CAD [-]."""
NOMINAL = inertial_parameters(panda().pinocchio())


def a_little_off(seed: int = 0) -> Arm:
    """Return an arm whose links are all a little off, drawn from the prior."""
    rng = np.random.default_rng(seed)
    while True:
        more = (SIZE * tolerances(NOMINAL) @ rng.normal(size=70)).reshape(7, 10)
        if consistent(NOMINAL + more).all():
            return with_inertias(panda(), NOMINAL + more)


def found_of(seed: int) -> tuple[LinkErrors, np.ndarray]:
    true = a_little_off(seed)
    predictor = TorquePredictor(data_of(panda(), hidden(panda(), true=true)), [TOLERANCES])
    predictor.refresh(predictor.problem, [])
    terms = predictor.problem.model([])
    found = link_errors(predictor, terms, predictor.problem.fit(terms))
    assert found is not None
    return found, inertial_parameters(true.pinocchio()) - NOMINAL


@pytest.fixture(scope="module")
def bare() -> Diagnosis:
    """The diagnosis of the arm, in which nothing else is hidden."""
    return diagnose_logs([hidden(panda(), true=a_little_off())], panda())


@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_the_truth_is_within_the_doubt(seed: int) -> None:
    """Law checked: eᵀC⁻¹e of the error e follows χ² with 70 degrees of freedom."""
    ours, true = found_of(seed)
    e = true.ravel() - ours.changes.ravel()
    size = np.sqrt(np.diag(ours.covariance))
    square, v = np.linalg.eigh(ours.covariance / np.outer(size, size))
    kept = square > 1e-9
    far = float(np.square((v[:, kept].T @ (e / size)) / np.sqrt(square[kept])).sum())
    assert 30 < far * 70 / kept.sum() < 120
    inside = np.abs(true[:, 0] - ours.mass[:, 0]) < ours.mass[:, 1]
    assert inside.sum() >= 6


@pytest.mark.slow
def test_a_model_hands_its_doubt_on(bare, tmp_path) -> None:
    """A tool of 1 kg is weighed on the next day; the interval knows what the first day left."""
    arm, true = panda(), a_little_off()
    assert bare.links is not None
    assert not bare.causes
    path = write_model(tmp_path, bare)
    known = read(path)
    assert known.links is not None
    assert np.array_equal(known.links, root_of(bare.links.covariance))
    tool = cause_named("payload")
    body = tool.part_of(np.array([1.0, 0.0, 0.0, 0.05, *[0.0] * 6]), (0.0, 0.0, 0.0))[0]
    log = hidden(arm, true=tool.changed(true, part("payload", 0, *body)), seed=2)
    later = diagnose_logs([log], arm, nominal=path)
    assert [c.name for c in later.causes] == ["payload"]
    weighed = later.causes[0].parameters[0]["mass_kg"]
    low, high = weighed.ci95
    assert low < 1.0 < high
    assert high - low < 0.3
