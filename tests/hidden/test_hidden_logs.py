"""Simulated logs: what each hidden cause does by itself, and links that are all a little off."""

from typing import Any

import numpy as np
import pytest

from stiction_envs.gap.signals.dataset import Data, assemble
from stiction_envs.gap.signals.prepare import prepare
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.hidden_logs import make_case
from stiction_envs.hidden.worlds import scattered
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import Arm, load_arm
from stiction_envs.robots.regressor import consistent, inertial_parameters

SHORT: dict[str, Any] = {"motion": "fourier", "joint": 2, "size": 0.6, "seconds": 8.0}
POSES: dict[str, Any] = {"motion": "poses", "seconds": 8.0, "known": False}


def against(arm: Arm, logs: list[JointLog]) -> Data:
    return assemble(arm, prepare(logs))


def rms(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))


def test_each_of_two_effects_is_measured_by_itself() -> None:
    case = make_case(4, ("torque_offset", "torque_scale"), **SHORT)
    offset = case.hidden[0].values["offset_nm"]
    assert case.alone.shape == (2, 7)
    assert np.isclose(case.alone[0, 1], abs(float(offset)), rtol=0.05)  # type: ignore[arg-type]
    assert np.all(case.effect <= case.alone.sum(axis=0) + 0.02)
    assert case.alone[:, 1].min() > 0.1


def test_a_phantom_is_in_the_makers_arm_and_not_in_the_log() -> None:
    case = make_case(3, ("phantom_payload",), second=4.0, **POSES)
    mass = case.hidden[0].values["mass_kg"]
    assert case.hidden[0].name == "payload"
    assert case.robot.payload is not None
    assert case.robot.payload[0] == -mass > 0.3  # type: ignore[operator]
    assert case.effect[1] > 0.5
    for logs, arm, lacks in (
        (case.logs, case.robot, True),
        (case.logs, load_arm("panda"), False),
        (case.second, load_arm("panda"), False),
    ):
        left = rms(against(arm, logs).residual)[1]
        assert (left > 0.5) == lacks
        assert lacks or left < 0.1


def test_a_joint_that_reads_off_stands_elsewhere_and_goes_on_from_there() -> None:
    """The arm at the angle less the offset explains the log, the one at the angle does not."""
    case = make_case(3, ("encoder_offset",), joint=2, size=0.8, second=4.0, **POSES)
    offset = float(case.hidden[0].values["offset_rad"])  # type: ignore[arg-type]
    assert case.effect[1] > 0.5
    for logs in (case.logs, case.second):
        data = against(load_arm("panda"), logs)
        there = data.q - offset * np.eye(7)[1]
        right = inverse_dynamics(data.recording.pinocchio, there, data.dq, data.ddq)
        left = [rms(data.tau - x)[1] for x in (data.rigid, right)]
        assert left[0] > 0.5 > 5 * left[1]


def test_missing_gravity_is_that_share_of_it() -> None:
    case = make_case(5, ("gravity_compensation_missing",), size=0.5, **POSES)
    share = float(case.hidden[0].values["share"])  # type: ignore[arg-type]
    data = against(load_arm("panda"), case.logs)
    g = data.recording.gravity[:, 1]
    assert -(data.residual[:, 1] @ g) / (g @ g) == pytest.approx(share, rel=0.02)
    assert case.effect[1] == pytest.approx(share * rms(g), rel=0.1)


@pytest.fixture(scope="module")
def makers() -> np.ndarray:
    """(7, 10) parameters of the links as the makers know them."""
    return inertial_parameters(load_arm("panda").pinocchio())


@pytest.mark.parametrize("scatter", [0.03, 0.2])
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


def test_links_have_a_random_stream_of_their_own_and_are_not_what_is_hidden() -> None:
    """Motion, friction, hidden cause and stamps are those of the exact arm."""
    exact = make_case(6, ("payload",), known=True, **SHORT)
    off = make_case(6, ("payload",), known=True, scatter=0.1, **SHORT)
    assert exact.hidden == off.hidden
    np.testing.assert_array_equal(exact.logs[0].t, off.logs[0].t)
    np.testing.assert_array_equal(exact.bare.coulomb, off.bare.coulomb)
    assert exact.bare.rigid.xml == load_arm("panda").xml
    assert np.abs(exact.logs[0].tau - off.logs[0].tau).max() > 0.3
    np.testing.assert_allclose(off.effect, exact.effect, rtol=0.02, atol=0.005)
    assert exact.effect[1] > 1
