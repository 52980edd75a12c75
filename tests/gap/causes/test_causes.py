"""Every cause: its interface, and its columns against the physical law."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES, parameter_units
from stiction_envs.gap.causes.base import limits
from stiction_envs.gap.signals.bristle import bristles, grown
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.robots import load_arm


@pytest.fixture(scope="module")
def data() -> Data:
    case = make_case(1, motion="fast", known=False, seconds=10.0)
    return assemble(load_arm("panda"), prepare(case.logs))


@pytest.mark.parametrize("cause", CAUSES, ids=lambda c: c.name)
def test_columns_bounds_values_and_view_fit_together(cause, data: Data) -> None:
    shape = cause.shapes(data, 3, data.rigid[:, 3])[0]
    columns = cause.columns(data, 3, shape)
    prior = cause.prior(data, 3, shape)
    (low, high), size = limits(cause, prior, data), prior.size
    assert np.all(size > 0)
    assert np.isfinite(size).all()
    assert len(size) == len(low)
    assert len(columns) == len(data.t)
    if columns.ndim == 3:
        assert columns.shape[1] == data.n
        columns = columns[:, 3]
    fewer = cause.name == "position_dependent_torque"  # of a lower order
    assert columns.shape[1] == len(low) or (fewer and columns.shape[1] < len(low))
    assert len(low) == len(high)
    assert np.all(low < high)
    assert np.isfinite(columns).all()
    values = cause.values(np.full(len(low), 0.1), shape)
    assert set(values) <= {p.name for p in cause.parameters}
    assert all(np.isfinite(np.ravel(v)).all() for v in values.values())
    assert cause.view.label.endswith("]")
    assert cause.view.note
    if cause.view.of is not None:
        x = cause.view.of(data, 3, shape)
        assert x.shape == data.t.shape
        assert np.isfinite(x).all()
        assert np.ptp(x) > 0
    assert cause.view.limit is None or cause.view.limit(shape) > 0


def test_every_parameter_but_ratios_and_counts_has_a_unit() -> None:
    ratios, counts = {"load_coefficient", "scale", "share"}, {"order", "link"}
    without = {p.name for c in CAUSES for p in c.parameters} - set(parameter_units())
    assert without == ratios | counts


def test_a_grown_bristle_is_the_difference_of_two() -> None:
    """LuGre of level g + εw less that of g, over ε, by fine integration."""
    t = np.linspace(0, 6, 30_001)
    way, sigma, level, eps = 3e-3 * np.sin(2 * t) + 1e-3 * np.sin(7 * t), 1000.0, 0.5, 1e-4
    weight = 1.0 + 0.3 * np.cos(t)
    z = np.zeros((2, len(t)))
    for k, step in enumerate(np.diff(way)):
        g = level + np.array([0.0, eps]) * weight[k + 1]
        end = np.sign(step) * g / sigma
        z[:, k + 1] = end + (z[:, k] - end) * np.exp(-sigma * abs(step) / g)
    expected = sigma * (z[1] - z[0]) / eps
    runs = [slice(0, len(t))]
    zeta = bristles(way[:, None], runs, np.array([[level / sigma]]))[:, 0, 0]
    found = grown(way, runs, level / sigma, zeta, weight)
    late = t > 2
    # once a bristle has settled, that it lags a level that changes slowly is left out
    assert np.allclose(found[late], expected[late], atol=0.05)
    assert np.abs(found - weight * zeta)[late].max() > 0.1
