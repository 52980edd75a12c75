"""Arms whose links are all a little off: the case's other draws, the links, and their torques."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from stiction_envs.errors import StictionError
from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.hidden.hidden_effects import World
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.hidden.hidden_motions import fourier
from stiction_envs.hidden.imperfect_arms import scattered
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.regressor import (
    consistent,
    from_pseudo_inertia,
    inertial_parameters,
    pseudo_inertia,
    torque_regressor,
)

SHORT: dict[str, Any] = {"motion": "fourier", "joint": 2, "size": 0.6, "seconds": 8.0}
SETTLED = 500
"""Rows of the first second, when the motion begins."""


@pytest.fixture(scope="module")
def makers() -> np.ndarray:
    """(7, 10) parameters of the links as the makers know them."""
    return inertial_parameters(load_arm("panda").pinocchio())


def against(arm: Arm, logs: list[JointLog]) -> Data:
    return assemble(arm, prepare(logs))


def rms(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))


# ---- the draws -----------------------------------------------------------------------------------


def test_links_and_set_up_have_a_random_stream_of_their_own() -> None:
    """The motion, the friction, the hidden cause and the time stamps are those of the exact arm."""
    exact = make_case(4, ("coulomb_friction",), known=True, **SHORT)
    off = make_case(4, ("coulomb_friction",), known=True, scatter=0.05, imperfect=True, **SHORT)
    assert exact.hidden == off.hidden
    np.testing.assert_array_equal(exact.logs[0].t, off.logs[0].t)
    for name in ("coulomb", "viscous", "rotor"):
        np.testing.assert_array_equal(getattr(exact.bare, name), getattr(off.bare, name))
    assert exact.bare.rigid.xml == load_arm("panda").xml
    assert np.abs(exact.logs[0].tau - off.logs[0].tau).max() > 0.3


def test_an_exact_arm_that_is_handed_over_gives_the_same_bits() -> None:
    alone = make_case(6, ("payload",), known=False, second=3.0, **SHORT)
    given = make_case(6, ("payload",), known=False, second=3.0, bare=World(), **SHORT)
    for one, two in ((alone.logs, given.logs), (alone.unhidden, given.unhidden)):
        np.testing.assert_array_equal(one[0].q, two[0].q)
        np.testing.assert_array_equal(one[0].tau, two[0].tau)
    np.testing.assert_array_equal(alone.effect, given.effect)


def test_another_log_of_the_arm_has_its_links_and_what_is_mounted() -> None:
    first = make_case(5, known=True, scatter=0.05, motion="fourier", seconds=6.0)
    other = make_case(15, bare=first.bare, motion="fast", seconds=6.0)
    assert other.bare.rigid.xml == first.bare.rigid.xml
    np.testing.assert_array_equal(other.bare.coulomb, first.bare.coulomb)
    mounted = dataclasses.replace(first.bare, payload=(1.0, np.array([0.0, 0.0, 0.05])))
    loaded = make_case(15, bare=mounted, motion="fast", seconds=6.0)
    assert loaded.hidden == ()
    assert np.abs(loaded.logs[0].q - other.logs[0].q).max() < 2e-3
    more = rms(loaded.logs[0].tau - other.logs[0].tau)
    assert more[1] > 3
    assert more[6] < 1


# ---- the links -----------------------------------------------------------------------------------


@pytest.mark.parametrize("scatter", [0.03, 0.1, 0.2])
def test_scattered_links_can_exist_and_are_as_far_off_as_said(
    makers: np.ndarray, scatter: float
) -> None:
    rng = np.random.default_rng(1)
    drawn = np.stack([scattered(makers, scatter, rng) for _ in range(200)])
    assert consistent(drawn).all()
    mass = drawn[..., 0] / makers[:, 0] - 1
    centre = drawn[..., 1:4] / drawn[..., :1] - makers[:, 1:4] / makers[:, :1]
    # of 1400 draws and of 4200, to four standard errors
    assert mass.std() == pytest.approx(scatter, rel=4 / np.sqrt(2 * mass.size))
    assert centre.std() == pytest.approx(0.1 * scatter, rel=4 / np.sqrt(2 * centre.size))
    assert abs(mass.mean()) < 4 * scatter / np.sqrt(mass.size)


def test_without_scatter_links_are_the_makers(makers: np.ndarray) -> None:
    same = scattered(makers, 0.0, np.random.default_rng(1))
    np.testing.assert_allclose(same, makers, rtol=0, atol=1e-14 * makers.max())


def test_a_scatter_out_of_range_is_refused(makers: np.ndarray) -> None:
    with pytest.raises(StictionError, match=r"scatter 0\.5: expected 0 to 0\.2"):
        scattered(makers, 0.5, np.random.default_rng(1))


# ---- the torques ---------------------------------------------------------------------------------


def tangent(phi: np.ndarray) -> np.ndarray:
    """(13, 7, 10) derivatives of links at scatter 0: by mass, by centre, by stretch.

    dJ = J dm + dT J + J dTᵀ with dT the derivative of the affine map about the link's centre.
    """
    j = pseudo_inertia(phi)
    centre = phi[:, 1:4] / phi[:, :1]
    out = [from_pseudo_inertia(j)]
    for axis in range(3):
        d = np.zeros((4, 4))
        d[axis, 3] = 0.1
        out.append(from_pseudo_inertia(d @ j + j @ d.T))
    for row, column in np.ndindex(3, 3):
        d = np.zeros((len(phi), 4, 4))
        d[:, row, column] = 1.0
        d[:, row, 3] = -centre[:, column]
        out.append(from_pseudo_inertia(d @ j + j @ d.transpose(0, 2, 1)))
    return np.stack(out)


def test_torques_of_scattered_links_have_the_size_of_the_tangent(makers: np.ndarray) -> None:
    """τ − τ_makers = W δφ; its mean square over arms is s² Σ (W dφ)², to first order."""
    t = np.arange(0, 8, 0.05)
    q = fourier(np.random.default_rng(3), t)
    dq = np.gradient(q, t, axis=0)
    w = torque_regressor(load_arm("panda").pinocchio(), q, dq, np.gradient(dq, t, axis=0))
    columns = tangent(makers)
    scatter, arms = 0.03, 400
    links = [np.einsum("tjlp,klp->tjkl", w.reshape(*w.shape[:2], 7, 10), columns)]
    expected = scatter * np.sqrt((links[0] ** 2).sum(axis=(2, 3)).mean(axis=0))
    rng = np.random.default_rng(7)
    off = np.stack([w @ (scattered(makers, scatter, rng) - makers).ravel() for _ in range(arms)])
    # a mean square of 400 Gaussian arms, the first joint's of few independent draws
    np.testing.assert_allclose(np.sqrt((off**2).mean(axis=(0, 1))), expected, rtol=0.12)


def test_the_residual_of_a_log_is_that_of_its_links(makers: np.ndarray) -> None:
    case = make_case(8, known=False, scatter=0.03, motion="fourier", seconds=8.0)
    data = against(load_arm("panda"), case.logs)
    own = against(case.bare.rigid, case.logs)
    off = inertial_parameters(case.bare.rigid.pinocchio()) - makers
    model = load_arm("panda").pinocchio()
    predicted = torque_regressor(model, data.q, data.dq, data.ddq) @ off.ravel()
    np.testing.assert_allclose(data.residual - own.residual, predicted, atol=1e-6)
    assert np.all(rms(own.residual[SETTLED:]) < 0.03)
    assert rms(data.residual)[1] > 0.3


def test_an_effect_is_the_hidden_cause_s_not_the_links() -> None:
    exact = make_case(6, ("payload",), known=False, **SHORT)
    off = make_case(6, ("payload",), known=False, scatter=0.1, imperfect=True, **SHORT)
    np.testing.assert_allclose(off.effect, exact.effect, rtol=0.02, atol=0.005)
    assert exact.effect[1] > 1
    none = make_case(6, known=False, scatter=0.1, imperfect=True, **SHORT)
    assert none.effect.max() < 0.01


def test_the_exact_arm_explains_the_log_in_which_nothing_is_hidden() -> None:
    case = make_case(6, ("payload",), known=False, scatter=0.1, imperfect=True, second=6.0, **SHORT)
    left = rms(against(case.bare.rigid, case.unhidden).residual[SETTLED:])
    assert left.max() < 0.03
    makers = rms(against(load_arm("panda"), case.unhidden).residual[SETTLED:])
    assert makers[1] > 10 * left[1]
