"""Every cause by itself: its face, its columns against what the law says."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.gap.logs.causes import CAUSES
from stiction_envs.gap.logs.causes.backlash import crossings
from stiction_envs.gap.logs.causes.deflection import mass_matrix
from stiction_envs.gap.logs.causes.joint_elasticity import deflection
from stiction_envs.gap.logs.data import Data, assemble, bristles, inverse_dynamics
from stiction_envs.gap.signals import prepare
from stiction_envs.robots import load_arm
from tests.gap.logs.hidden_logs import EXCITED_BY, make_case

BY_NAME = {c.name: c for c in CAUSES}


@pytest.fixture(scope="module")
def data() -> Data:
    case = make_case(1, motion="fast", known=False, seconds=10.0)
    return assemble(load_arm("panda"), prepare(case.logs))


def test_there_are_the_seventeen_of_the_contract() -> None:
    assert list(BY_NAME) == list(EXCITED_BY)


@pytest.mark.parametrize("cause", CAUSES, ids=lambda c: c.name)
def test_columns_are_finite_and_as_many_as_the_bounds(cause, data: Data) -> None:
    shape = cause.shapes(data, 3, data.residual[:, 3])[0]
    columns = cause.columns(data, 3, shape)
    low, high = cause.bounds(data)
    assert columns.shape == (len(data.t), len(low))
    assert len(low) == len(high)
    assert np.all(low < high)
    assert np.isfinite(columns).all()
    assert cause.what
    assert cause.record


@pytest.mark.parametrize("cause", CAUSES, ids=lambda c: c.name)
def test_values_have_the_contracts_keys(cause, data: Data) -> None:
    shape = cause.shapes(data, 3, data.residual[:, 3])[0]
    values = cause.values(np.full(len(cause.bounds(data)[0]), 0.1), shape)
    named = {p.name for p in cause.parameters}
    assert set(values) <= named
    assert all(np.isfinite(np.ravel(v)).all() for v in values.values())


def test_payload_columns_are_the_torque_of_an_arm_with_one(data: Data) -> None:
    """Linear in mass, first moment and inertia: the regressor against the loaded model."""
    mass, com = 1.3, np.array([0.02, -0.03, 0.07])
    loaded = load_arm("panda", payload=(mass, *com)).pinocchio()
    rows = slice(100, 140)
    more = inverse_dynamics(loaded, data.q[rows], data.dq[rows], data.ddq[rows])
    more -= data.rigid[rows]
    about = 0.4 * mass * 0.03**2 * np.eye(3) + mass * (com @ com * np.eye(3) - np.outer(com, com))
    xx, xy, yy = about[0, 0], about[0, 1], about[1, 1]
    coefficients = np.array(
        [mass, *(mass * com), xx, xy, yy, about[0, 2], about[1, 2], about[2, 2]]
    )
    for j in range(7):
        own = BY_NAME["payload"].columns(data, j, ())[rows] @ coefficients
        assert np.allclose(own, more[:, j], atol=1e-6)


def test_tilt_columns_are_the_gravity_of_a_leaning_arm(data: Data) -> None:
    lean, towards = 0.2, 0.7
    model = data.pinocchio.copy()
    g = float(np.linalg.norm(model.gravity.linear))
    side = np.sin(lean) * np.array([np.cos(towards), np.sin(towards)])
    model.gravity.linear = g * np.array([*side, -np.cos(lean)])
    zero = np.zeros_like(data.q)
    torque = inverse_dynamics(model, data.q, zero, zero)
    for j in range(7):
        own = BY_NAME["base_tilt"].columns(data, j, ()) @ [*side, 1 - np.cos(lean)]
        assert np.allclose(data.gravity[:, j] + own, torque[:, j], atol=1e-9)


def test_a_bristle_ends_at_its_level_and_remembers_at_rest() -> None:
    """After way x: 1 − e^(−x/d); at rest it stays."""
    way = np.concatenate([np.linspace(0, 0.01, 50), np.full(50, 0.01)])[:, None]
    zeta = bristles(way, [slice(0, 100)], np.array([[0.005]]))[:, 0, 0]
    assert np.allclose(zeta[:50], 1 - np.exp(-way[:50, 0] / 0.005))
    assert np.allclose(zeta[50:], zeta[49])


def test_a_gap_opens_by_its_width_on_both_flanks(data: Data) -> None:
    delta = crossings(data, 2, 0.02)
    assert np.isclose(delta.max(), 0.01)
    assert np.isclose(delta.min(), -0.01)


def test_a_stiff_spring_yields_load_over_stiffness(data: Data) -> None:
    """Far below resonance δ = −load/K."""
    delta = deflection(data, 1, 1e6)
    assert np.allclose(delta[200:], -data.rigid[200:, 1] / 1e6, rtol=0.05, atol=2e-6)


def test_the_mass_matrix_is_symmetric_and_positive(data: Data) -> None:
    mass = mass_matrix(data)[::500]
    assert np.allclose(mass, np.swapaxes(mass, 1, 2))
    assert np.all(np.linalg.eigvalsh(mass) > 0)


def test_blocks_hold_time_together_and_keep_apart(data: Data) -> None:
    """Each block is one stretch of time; between two lies a guard."""
    for b in range(data.blocks):
        rows = np.flatnonzero(data.block == b)
        assert np.all(np.diff(rows) == 1)
    assert np.all(np.diff(data.block[data.block >= 0]) >= 0)
    assert (data.block == -1).any()
