"""Parameters of causes: refined between the grid's points, and with intervals that mean it."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES
from stiction_envs.gap.causes.gear import backlash
from stiction_envs.gap.estimates import FAR, draw, estimates, sharpen
from stiction_envs.gap.selection.candidates import ARM, Candidate, RegressorLibrary
from stiction_envs.gap.settings import gap_settings
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


def test_intervals_are_made_of_resamples(library: RegressorLibrary) -> None:
    terms = sharpen(library, [DRY, PAYLOAD, on_the_grid(library)])
    stribeck = terms[2]
    c = library.grams.fit(library.model_columns(terms))
    draws = draw(library, terms, c, seed=0)
    resamples = library.data.settings.estimates.resamples
    assert [len(x) for x in draws] == [resamples] * 3
    for (own, _), best in zip((x[0] for x in draws), library.split(terms, c), strict=True):
        assert own.shape == best.shape
    levels = np.array([own[0] for own, _ in draws[0]])
    assert levels.mean() == pytest.approx(LEVEL, rel=0.02)
    assert 1e-4 < levels.std() / LEVEL < 0.05
    speeds = np.array([shape[0] for _, shape in draws[2]])
    assert np.median(speeds) == pytest.approx(stribeck.shape[0])
    assert 1e-4 < speeds.std() / TRUE_SPEED < 0.1
    assert all(shape[1:] == stribeck.shape[1:] for _, shape in draws[2])
    masses = np.array([own[0] for own, _ in draws[1]])
    assert masses.mean() == pytest.approx(MASS, rel=0.02)
    again = draw(library, terms, c, seed=0)
    assert all(np.array_equal(a[0], b[0]) for a, b in zip(draws[1], again[1], strict=True))
    for term, key, truth in ((DRY, "coulomb_nm", LEVEL), (stribeck, "stiction_nm", STICTION)):
        found = estimates(library, terms, [term], c, draws)[4][key]
        low, high = found.ci95
        assert low < truth < high
        assert 0.06 * truth < high - low < 0.4 * truth
        assert not found.on_bound
    without = estimates(library, terms, [DRY], c, None)[4]["coulomb_nm"]
    room = library.data.settings.estimates.model_error
    np.testing.assert_allclose(without.ci95, without.value * np.array([1 - room, 1 + room]))


def test_resamples_stay_within_bounds(library: RegressorLibrary) -> None:
    """Friction of a joint that has none is not negative in any of them, and is on its bound."""
    terms = [Candidate("coulomb_friction", 1, ()), PAYLOAD]
    c = library.grams.fit(library.model_columns(terms))
    levels = np.array([own[0] for own, _ in draw(library, terms, c, seed=0)[0]])
    assert levels.min() >= 0.0
    assert np.count_nonzero(levels == 0.0) > 10


def test_the_interval_is_students_with_far_samples_cut_off(library: RegressorLibrary) -> None:
    """Deviations are half of 16 to 84 %; a sample at infinity counts as `FAR` of them."""
    s = gap_settings().estimates
    drawn = [(np.array([float(x)]), ()) for x in range(100)] + [(np.array([1e6]), ())]
    found = estimates(library, [VISCOUS], [VISCOUS], np.array([50.0]), [drawn])
    counted = np.append(np.arange(100.0), 50 + FAR * (84 - 16) / 2)
    spread = s.interval * counted.std() + s.model_error * 50
    key = next(iter(found[4]))
    np.testing.assert_allclose(found[4][key].ci95, [50 - spread, 50 + spread])


def profiled(library: RegressorLibrary, monkeypatch, middle: float, width: float):
    """The Stribeck velocity's estimate, with a parabola over its logarithm for a profile."""
    terms = sharpen(library, [DRY, PAYLOAD, on_the_grid(library)])
    stribeck = terms[2]

    def parabola(self, data, joint, shape, residual, weight):
        at = shape[0] * np.geomspace(0.5, 2.0, 2001)
        # of what the others leave, which is the cause's own torque
        assert np.sum(weight * residual**2) > 100 * np.sum(weight) * library.data.noise[joint] ** 2
        return at, 7.0 * (1 + np.square(np.log(at / (middle * shape[0])) / width))

    c = library.grams.fit(library.model_columns(terms))
    before = estimates(library, terms, [stribeck], c, None)[4]
    cause = type(BY_NAME["stribeck_friction"])
    monkeypatch.setattr(cause, "profile", parabola)
    return before, estimates(library, terms, [stribeck], c, None)[4]


def test_a_profile_widens_an_interval_to_its_likelihood(library, monkeypatch) -> None:
    """Ends where 1 + x²/w² = 1 + t²/(B − 1); other parameters keep theirs."""
    before, found = profiled(library, monkeypatch, 1.05, 0.1)
    s, blocks = library.data.settings.estimates, library.data.blocks
    reach = 0.1 * s.interval / np.sqrt(blocks - 1)
    value = found["stribeck_velocity"].value
    ends = value * 1.05 * np.exp([-reach, reach])
    low, high = found["stribeck_velocity"].ci95
    assert low == pytest.approx(min(ends[0], before["stribeck_velocity"].ci95[0]), rel=2e-3)
    assert high == pytest.approx(ends[1], rel=2e-3)
    assert high > before["stribeck_velocity"].ci95[1]
    assert found["stiction_nm"].ci95 == before["stiction_nm"].ci95
    assert not found["stribeck_velocity"].on_bound


def test_a_profile_that_never_rises_is_on_its_bound(library, monkeypatch) -> None:
    _, found = profiled(library, monkeypatch, 1.0, 10.0)
    assert found["stribeck_velocity"].on_bound
    assert found["stribeck_velocity"].ci95[1] == pytest.approx(
        2.0 * found["stribeck_velocity"].value
    )


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
