"""Every cause: its interface, and its columns against the physical law."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.gap.causes import CAUSES, Part, cause_named, parameter_units
from stiction_envs.gap.causes.base import filtered_columns, limits
from stiction_envs.gap.causes.body.bodies import changed_link
from stiction_envs.gap.signals.bristle import bristles, grown
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.regressor import consistent, inertial_parameters
from tests.gap.small_logs import data_of, hidden, panda


@pytest.fixture(scope="module")
def data() -> Data:
    case = make_case(1, motion="fast", known=False, seconds=10.0)
    return assemble(load_arm("panda"), prepare(case.logs))


@pytest.mark.parametrize("cause", CAUSES, ids=lambda c: c.name)
def test_columns_bounds_values_and_view_fit_together(cause, data: Data) -> None:
    shape = cause.shapes(data, 3, data.rigid[:, 3])[0]
    (columns,) = filtered_columns(cause, data, 3, [shape])
    prior = cause.prior(data, 3, shape)
    (low, high), size = limits(cause, prior, data), prior.size
    assert np.all(size > 0)
    assert np.isfinite(size).all()
    assert len(size) == len(low)
    assert len(columns) == len(data.q)
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
        assert x.shape == data.q[:, 0].shape
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


def test_a_changed_link_is_a_body_and_its_columns_are_its_slope(data: Data) -> None:
    """Mass and centre are those asked for; to first order the torque is that of the columns."""
    phi, cause = inertial_parameters(data.recording.pinocchio)[3], cause_named("link_parameters")
    change = np.array([-0.6 * phi[0], 0.1, -0.2, 0.15])
    new = changed_link(phi, change)
    assert consistent(new)
    assert new[0] == pytest.approx(0.4 * phi[0])
    shift = new[1:4] / new[0] - phi[1:4] / phi[0]
    assert np.allclose(shift, change[1:] / new[0])
    assert np.allclose(cause.values(change, (4.0, float(phi[0])))["com_m"], shift)
    small = 1e-4 * change
    part = Part(cause=cause.name, joint=4, shape=(), coefficients=tuple(small.tolist()))
    arm = cause.changed(load_arm("panda"), part)
    exact = inverse_dynamics(arm.pinocchio(), data.q, data.dq, data.ddq) - data.rigid
    assert np.allclose(cause.columns(data, 3, ()) @ small, exact, atol=1e-6)
    assert np.abs(exact).max() > 1e-4


# ---- a zero that is off --------------------------------------------------------------------------

PENDULUM = """
<mujoco model="pendulum">
  <compiler angle="degree" autolimits="true"/>
  <default><joint axis="0 1 0" range="-170 170"/></default>
  <worldbody><body name="rod" pos="0 0 1" euler="0 0 40"><joint name="swing"/>
    <inertial pos="0 0 -0.4" mass="2" diaginertia="1e-6 1e-6 1e-6"/>
    <body name="tip" pos="0.1 0 -0.5" euler="10 0 -25"><joint name="turn" pos="0.02 0 0.03"/>
      <inertial pos="0 0 -0.1" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>
      <site name="flange" pos="0 0 -0.2"/>
    </body>
  </body></worldbody>
</mujoco>
"""


def off_by(arm: Arm, offset: float, joint: int) -> Arm:
    part = Part(cause="encoder_offset", joint=joint, shape=(offset,), coefficients=(offset,))
    return cause_named("encoder_offset").changed(arm, part)


@pytest.mark.parametrize("joint", range(1, 8))
def test_an_arm_whose_zero_is_off_is_the_arm_at_another_angle(joint: int, data: Data) -> None:
    offset, columns = 0.2, cause_named("encoder_offset").columns
    there = data.q - offset * np.eye(7)[joint - 1]
    expected = inverse_dynamics(data.recording.pinocchio, there, data.dq, data.ddq)
    model = off_by(data.arm, offset, joint).pinocchio()
    torque = inverse_dynamics(model, data.q, data.dq, data.ddq)
    np.testing.assert_allclose(torque, expected, atol=1e-9)
    own = columns(data, joint - 1, (offset,))[..., 0] * offset
    np.testing.assert_allclose(data.recording.rigid + own, expected, atol=1e-9)
    slope, near = (columns(data, joint - 1, (x,))[..., 0] for x in (0.0, 1e-5))
    np.testing.assert_allclose(slope, near, atol=1e-3)


def test_angles_joint_axes_and_anchors_of_any_file_are_kept(tmp_path: Path) -> None:
    """Euler angles in degrees, an axis that is a default, an anchor away from the link's origin."""
    (tmp_path / "pendulum.xml").write_text(PENDULUM, encoding="utf-8")
    pendulum = load_arm(tmp_path / "pendulum.xml")
    q, one = np.array([[0.3, -0.8]]), np.array([[1.0, 2.0]])
    for joint, moved in ((1, [[0.1, -0.8]]), (2, [[0.3, -1.0]])):
        torque = inverse_dynamics(off_by(pendulum, 0.2, joint).pinocchio(), q, one, one)
        expected = inverse_dynamics(pendulum.pinocchio(), np.array(moved), one, one)
        np.testing.assert_allclose(torque, expected, atol=1e-12)


# ---- smooth torque over the angle ----------------------------------------------------------------


def test_beyond_the_angles_of_the_logs_a_smooth_torque_is_constant(data: Data) -> None:
    """Law checked: a joint that goes on has the torque at the last known angle."""
    low, high = np.percentile(data.q[:, 3], [40, 60])
    still = replace(data, recording=replace(data.recording, dt=float("nan")))  # no filter
    shape, coefficients = (2.0, float(low), float(high)), (0.4, 1.0, -0.5, 0.2, 0.3)
    torque = cause_named("position_dependent_torque").columns(still, 3, shape) @ coefficients
    q = np.clip(data.q[:, 3], low, high)
    waves = np.stack([q**0, np.cos(q), np.sin(q), np.cos(2 * q), np.sin(2 * q)], axis=1)
    np.testing.assert_allclose(torque, waves @ coefficients)


def test_harmonics_that_only_cancel_at_the_angles_of_the_logs_are_implausible(data: Data) -> None:
    """Law checked: the iiwa's joint 3 fits as well with 48 N·m that cancel; found on its log."""
    q = data.q.copy()
    q[:, 2] = np.linspace(-0.8, 0.8, len(q))
    sweep = replace(data, recording=replace(data.recording, q=q))
    cancelling = np.array([31.18, -47.822, -1.293, 20.511, 1.147, -3.69, -0.212])
    smaller = np.array([2.154, -3.128, -0.497, 1.16, 0.442])
    possible = cause_named("position_dependent_torque").possible
    assert not possible(sweep, 2, cancelling, (3.0,), 0.0)
    assert possible(sweep, 2, smaller, (2.0,), 0.0)


# ---- friction that grows with load ---------------------------------------------------------------


def test_presliding_distances_without_load_grow_with_it() -> None:
    """The bristle stiffness does not change with the level: of 1 N·m, and 0.1 per N·m of load."""
    distance, level, growth, joint = 0.03, 1.0, 0.1, 3
    cause = cause_named("load_dependent_friction")
    data = data_of(panda(), hidden(panda())).with_presliding(np.full(7, distance))
    loaded = level + growth * data.recording.along_path(np.abs(data.rigid[:, joint]))
    bristle = np.zeros(len(loaded))
    bristle[0] = loaded[0] * data.directions[0, joint]
    for k, step in enumerate(np.diff(data.recording.reversal_path[:, joint])):
        end, distance_now = np.sign(step) * loaded[k + 1], loaded[k + 1] * distance / level
        bristle[k + 1] = end + (bristle[k] - end) * np.exp(-abs(step) / distance_now)
    bent = cause.resized((0.0, 0.0), np.array([growth]), level)
    assert bent == (growth / level, 0.0)
    left = []
    for shape in (bent, (0.0, 0.0)):
        dry = level * data.smooth(data.dry_friction_ratio(joint))
        found = dry + growth * next(filtered_columns(cause, data, joint, [shape]))[:, 0]
        left.append(np.sqrt(np.mean(np.square(found - data.smooth(bristle)))))
    assert left[0] < 0.2 * left[1]
    assert left[0] < 0.02 * growth * np.abs(data.rigid[:, joint]).mean()
