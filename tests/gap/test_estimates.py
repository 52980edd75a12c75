"""Parameters of causes: refined between the grid's points, and with intervals that mean it."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.causes.gear import backlash
from stiction_envs.gap.estimates import draw, estimates, sharpen
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.signals.dataset import Data
from tests.gap.small_logs import data_of, hidden, panda, with_torque

BY_NAME = {c.name: c for c in CAUSES}
DRY, VISCOUS = (Candidate(f"{name}_friction", 3, ()) for name in ("coulomb", "viscous"))
FLANGE = (0.0, 0.0, 0.0)
PAYLOAD = Candidate("payload", ARM, FLANGE)
TRUE_SPEED, LEVEL, STICTION, MASS, GAP = 0.063, 0.8, 0.5, 1.0, 0.02


@pytest.fixture(scope="module")
def bare() -> Data:
    return data_of(panda(), hidden(panda(), seconds=20.0))


@pytest.fixture(scope="module")
def library(bare: Data) -> RegressorLibrary:
    """Friction with a Stribeck curve in joint 4, and 1 kg on the flange."""
    torque = MASS * np.stack(
        [BY_NAME["payload"].columns(bare, j, FLANGE)[:, 0] for j in range(7)], axis=1
    )
    for name, shape, c in (
        ("coulomb_friction", (), LEVEL),
        ("stribeck_friction", (TRUE_SPEED, STICTION / LEVEL), STICTION),
    ):
        torque[:, 3] += c * BY_NAME[name].columns(bare, 3, shape)[:, 0]
    few = ("coulomb_friction", "viscous_friction", "stribeck_friction", "payload")
    return RegressorLibrary(with_torque(bare, torque), [c for c in CAUSES if c.name in few])


def on_the_grid(library: RegressorLibrary) -> Candidate:
    """Return the first candidate that was next to the truth."""
    tried = BY_NAME["stribeck_friction"].shapes(library.data, 3, library.residual[:, 3])
    near = min(tried, key=lambda shape: abs(np.log(shape[0] / TRUE_SPEED)))
    return Candidate("stribeck_friction", 3, near)


@pytest.mark.parametrize("place", [0, 1, 2])
def test_nonlinear_parameters_are_refined_whatever_else_is_there(library, place) -> None:
    """The Stribeck velocity to 2 %, with its part of friction: any order, with a payload."""
    terms = [DRY, PAYLOAD]
    terms.insert(place, on_the_grid(library))
    assert abs(np.log(terms[place].shape[0] / TRUE_SPEED)) > 0.05
    found = sharpen(library, terms)
    assert [(t.cause, t.joint) for t in found] == [(t.cause, t.joint) for t in terms]
    assert found[place].shape[0] == pytest.approx(TRUE_SPEED, rel=0.02)
    assert found[place].shape[1] == pytest.approx(STICTION / LEVEL, rel=0.05)
    left = library.grams.errors(library.model_columns(found))
    assert left[3] < library.grams.errors(library.model_columns(terms))[3]


@pytest.mark.parametrize("damping", [0.1, 0.2])
def test_the_interval_of_a_gap_allows_for_flanks_that_nobody_knows(damping, monkeypatch) -> None:
    """A gap whose flanks are a third softer than assumed looks narrower by 7 %."""
    bare = data_of(panda(), hidden(panda(), seconds=30.0, seed=4))
    usual = BY_NAME["backlash"]
    with monkeypatch.context() as soft:
        soft.setattr(backlash, "FLANK", 0.67 * backlash.FLANK)
        data = with_torque(bare, usual.spread(bare, 2, (GAP, damping))[..., 0])
    library = RegressorLibrary(data, [usual])
    shape = usual.shapes(data, 2, data.residual[:, 2])[0]
    terms = sharpen(library, [Candidate("backlash", 2, shape)])
    c = library.grams.fit(library.model_columns(terms))
    found = estimates(library, terms, terms, c, draw(library, terms, c, seed=0))[3]["gap_rad"]
    assert found.value < 0.97 * GAP
    assert found.ci95[0] < GAP < found.ci95[1]
    assert found.ci95[1] - found.ci95[0] < 0.3 * GAP
    assert not found.on_bound
