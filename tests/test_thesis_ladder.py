"""The ladder's yardsticks: known errors of rungs without physics, and its fast joint model."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.thesis_ladder.joint import Columns, breakaway
from benchmarks.thesis_ladder.rungs import lookup, nothing, with_drift
from benchmarks.thesis_ladder.scoring import cells, repeat_floor, score
from stiction_envs.friction.law import LuGre, simulate_joint


@pytest.fixture(scope="module")
def all_cells():
    return cells()


def test_cells(all_cells):
    assert len(all_cells) == 308
    assert sum(c.held_out for c in all_cells) == 196
    assert [(c.row.table, c.row.joint, c.row.frequency_hz) for c in all_cells if c.row.outlier] == [
        ("4.7", 2, 30.0)
    ]


def test_rungs_without_physics_have_the_known_errors(all_cells):
    """About 14 % if dither does nothing, 5.3 % for the lookup, 3.1 / 1.7 % for the repeats."""
    assert score("nothing", all_cells, nothing(all_cells)).mean == pytest.approx(14, abs=0.5)
    assert score("lookup", all_cells, lookup(all_cells)).mean == pytest.approx(5.3, abs=0.05)
    mean, median = repeat_floor(all_cells)
    assert mean == pytest.approx(3.1, abs=0.05)
    assert median == pytest.approx(1.7, abs=0.1)


def test_a_perfect_rung_scores_zero_but_for_nothing_broken(all_cells):
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


@pytest.mark.parametrize("stiffness", [np.inf, 1e4])
def test_the_fast_joint_agrees_with_the_reference(stiffness):
    """Against `friction.law.simulate_joint` at 0.05 ms, with and without dither."""
    rotor, link, rate = 0.1, 0.05 if np.isinf(stiffness) else 1.0, 0.5
    sigma1 = 2 * 0.4 * np.sqrt(1000 * (rotor + (link if np.isinf(stiffness) else 0)))
    spring = 0.3 * np.sqrt(1e4 * rotor)
    amplitude = np.array([0.0, 0.6])
    one = np.ones(2)
    fast = breakaway(
        Columns(
            stiction=0.6 * one,
            ratio=0.85 * one,
            stribeck=0.01 * one,
            bristle=1000.0 * one,
            damping=sigma1 * one,
            viscous=0.15 * one,
            rotor=rotor * one,
            stiffness=stiffness * one,
            spring_damping=spring * one,
            link=link * one,
            amplitude=amplitude,
            frequency=15.0 * one,
            rate=rate * one,
        ),
        longest=5.0,
    )
    h = 5e-5
    t = np.arange(int(2.5 / h)) * h
    held = np.floor(t / 1e-3 + 1e-9) * 1e-3
    command = rate * held[:, None] + amplitude * np.sin(2 * np.pi * 15.0 * held[:, None])
    gain = h / (h + 1 / (2 * np.pi * 100.0))
    filtered, y = np.empty_like(command), np.zeros(2)
    for k, u in enumerate(command):
        y = y + gain * (u - y)
        filtered[k] = y
    law = LuGre(
        stiction=0.6,
        coulomb=0.51,
        stribeck_velocity=0.01,
        bristle_stiffness=1000.0,
        bristle_damping=sigma1,
        viscous=0.15,
    )
    q, _ = simulate_joint(
        law,
        filtered,
        dt=h,
        inertia=rotor + (link if np.isinf(stiffness) else 0.0),
        stiffness=stiffness,
        link_inertia=link,
        damping=spring,
    )
    reference = rate * t[(q >= 0.15).argmax(axis=0)]
    np.testing.assert_allclose(fast, reference, rtol=0.02)
