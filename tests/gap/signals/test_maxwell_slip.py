"""Elements in parallel against their limit cases: full reversals, closed loops, rest."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.maxwell_slip import ELEMENTS, YIELDS, maxwell_slip

D = 0.01


def along(*turns: float) -> np.ndarray:
    """Path through some angles, 0.05 mrad a step."""
    parts = [np.linspace(a, b, round(abs(b - a) / 5e-5) + 1)[1:] for a, b in pairwise(turns)]
    return np.concatenate([turns[:1], *parts])


def both(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    runs = [slice(0, len(path))]
    one = bristles(path[:, None], runs, np.array([[D]]))[:, 0, 0]
    return one, maxwell_slip(path, runs, np.array([D]))[:, 0]


def test_after_full_reversals_elements_are_a_bristle() -> None:
    """−1 + 2 (1 − e^(−x/d)), but for the corners of a few elements."""
    path = along(0.0, 0.2, 0.0, 0.2)
    one, many = both(path)
    later = len(along(0.0, 0.2))
    off = np.abs(many - one)[later:]
    assert off.max() < 0.08
    assert off.mean() < 0.01
    assert many.max() == 1.0
    assert many.min() == -1.0


def test_small_loops_close_and_a_bristle_drifts() -> None:
    """Back at the turn of a small loop the elements go on as if there had been none."""
    path = along(0.0, 0.2, 0.192, *[0.196, 0.192] * 8)
    one, many = both(path)
    back = np.flatnonzero(np.abs(path - 0.192) < 1e-9)[1:]  # the first is on the way there
    assert np.ptp(many[back]) < 1e-9
    assert np.ptp(one[back]) > 0.05


def test_a_first_pull_is_half_a_reversal() -> None:
    """Masing's rule: from rest F(x), after a reversal 2 F(x/2) − 1."""
    path = along(0.0, 0.0004)
    path = np.concatenate([np.zeros(100), path, along(0.0004, 0.0008)[1:]])
    many = both(path)[1]
    soft = np.minimum(0.0008 / (YIELDS * D), 1.0).mean()
    assert np.isclose(many[-1], soft)
    assert not many[:100].any()
    assert len(YIELDS) == ELEMENTS
