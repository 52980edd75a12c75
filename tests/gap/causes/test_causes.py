"""Every cause: its interface, and its columns against the physical law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES, Part, parameter_units
from stiction_envs.gap.causes.base import limits, torque_of
from stiction_envs.gap.causes.body import payload
from stiction_envs.gap.causes.body.bodies import (
    body_columns,
    changed_link,
    link_directions,
    payload_of,
    with_link,
)
from stiction_envs.gap.causes.gear.joint_elasticity import deflection
from stiction_envs.gap.signals.bristle import bristles, grown
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.robots import load_arm
from stiction_envs.robots.regressor import consistent, inertial_parameters, pseudo_inertia

BY_NAME = {c.name: c for c in CAUSES}
LEAST = payload.LEAST_INERTIA


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


def test_payload_columns_are_the_torque_of_an_arm_with_one(data: Data) -> None:
    """Linear in mass and moment about its own centre: the regressor against the loaded model."""
    mass, com = 1.3, np.array([0.02, -0.03, 0.07])
    loaded = load_arm("panda", payload=(mass, *com)).pinocchio()
    rows = slice(100, 140)
    more = inverse_dynamics(loaded, data.q[rows], data.dq[rows], data.ddq[rows])
    more -= data.rigid[rows]
    coefficients = np.array([mass, *(mass * com), *[0.0] * 6])
    for j in range(7):
        own = BY_NAME["payload"].columns(data, -1, tuple(com))[rows, j] @ coefficients
        assert np.allclose(own, more[:, j], atol=1e-9)
        # about another centre its inertia is linear only, to second order of the distance
        near = BY_NAME["payload"].columns(data, -1, tuple(com + 0.01))[rows, j] @ coefficients
        assert np.abs(near - more[:, j]).max() < 0.01
    # a wider body has more of Σ: by its length along x
    long = 0.1**2 * mass
    stick = payload_of(np.array([mass, *(mass * com), long, *[0.0] * 5]), LEAST)
    spread = pseudo_inertia(stick)[:3, :3] - pseudo_inertia(payload_of(coefficients, LEAST))[:3, :3]
    assert np.allclose(spread, np.diag([long, 0.0, 0.0]))


def test_poses_have_no_torque_of_motion(data: Data) -> None:
    rest = replace(data, recording=replace(data.recording, dt=float("nan")))
    viscous = Part(cause="viscous_friction", joint=2, shape=(), coefficients=(1.0,))
    offset = Part(cause="torque_offset", joint=2, shape=(), coefficients=(0.5,))
    assert torque_of(BY_NAME["viscous_friction"], data, viscous).any()
    assert not torque_of(BY_NAME["viscous_friction"], rest, viscous).any()
    assert np.all(torque_of(BY_NAME["torque_offset"], rest, offset)[:, 1] == 0.5)


def test_a_changed_link_is_a_body_and_its_columns_are_its_slope(data: Data) -> None:
    """J' = (1 + s) T(δ) J T(δ)ᵀ: mass and centre are those asked for, the torque to first order."""
    phi = inertial_parameters(data.pinocchio)[3]
    change = np.array([-0.6 * phi[0], 0.1, -0.2, 0.15])
    new = changed_link(phi, change)
    assert consistent(new)
    assert new[0] == pytest.approx(0.4 * phi[0])
    shift = new[1:4] / new[0] - phi[1:4] / phi[0]
    assert np.allclose(shift, change[1:] / new[0])
    values = BY_NAME["link_parameters"].values(change, (4.0, float(phi[0])))
    assert np.allclose(values["com_m"], shift)
    small = 1e-4 * change
    first = link_directions(phi) @ small
    assert np.abs(changed_link(phi, small) - phi - first).max() < 1e-7
    torque = data.recording.derived(body_columns)[:, :, 12:16] @ small
    arm = with_link(load_arm("panda"), 4, small)
    exact = inverse_dynamics(arm.pinocchio(), data.q, data.dq, data.ddq) - data.rigid
    assert np.allclose(torque, exact, atol=1e-6)
    assert np.abs(exact).max() > 1e-4


def test_tilt_columns_are_the_gravity_of_a_leaning_arm(data: Data) -> None:
    lean, towards = 0.2, 0.7
    model = data.pinocchio.copy()
    g = float(np.linalg.norm(model.gravity.linear))
    side = np.sin(lean) * np.array([np.cos(towards), np.sin(towards)])
    model.gravity.linear = g * np.array([*side, -np.cos(lean)])
    zero = np.zeros_like(data.q)
    torque = inverse_dynamics(model, data.q, zero, zero)
    for j in range(7):
        own = BY_NAME["base_tilt"].columns(data, -1, tuple(side))[:, j] @ side
        assert np.allclose(data.recording.gravity[:, j] + own, torque[:, j], atol=1e-9)


def test_a_bristle_ends_at_its_level_and_remembers_at_rest() -> None:
    """After way x from rest: 1 − e^(−x/d); at rest it stays. A joint in motion slides already."""
    way = np.concatenate([np.zeros(20), np.linspace(0, 0.01, 50), np.full(50, 0.01)])[:, None]
    zeta = bristles(way, [slice(0, 120)], np.array([[0.005]]))[:, 0, 0]
    assert np.allclose(zeta[:70], 1 - np.exp(-way[:70, 0] / 0.005))
    assert np.allclose(zeta[70:], zeta[69])
    assert np.allclose(bristles(way[20:70], [slice(0, 50)], np.array([[0.005]])), 1.0)


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


def test_a_stiff_spring_yields_load_over_stiffness(data: Data) -> None:
    """Far below resonance δ = −load/K."""
    delta = deflection(data, 1, 1e6)
    assert np.allclose(delta[200:], -data.rigid[200:, 1] / 1e6, rtol=0.05, atol=2e-6)


def test_a_delays_low_pass_is_first_order(data: Data) -> None:
    """T y' + y = n, so that the column times −T is y − n."""
    lowpass = 0.03
    column = BY_NAME["actuator_delay"].columns(data, -1, (-lowpass, 1.0))[:, 1, 0]
    n = data.nominal[:, 1]
    y = n - lowpass * column
    run = data.runs()[0]
    left = lowpass * np.gradient(y[run], data.dt) + y[run] - n[run]
    assert np.abs(left[5:-5]).max() < 0.1 * np.abs(y - n)[run].max()
