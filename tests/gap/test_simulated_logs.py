"""Causes as textbooks write them, in logs as somebody else would simulate them.

Angles, speeds and accelerations are analytic, the torque is MuJoCo's of the nominal arm, the effect
is the textbook's formula, the noise is white.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.hidden.hidden_motions import MOTIONS
from stiction_envs.hidden.worlds import inverse_torque
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.robots import load_arm

Array = NDArray[np.float64]
CENTRE = np.array([0.0, -0.4, 0.0, -1.9, 0.0, 1.9, 0.5])
MIDDLE = np.array([0.0, 0.5, 0.0, -1.2, 0.0, 1.0, 0.0])
"""A pose in the middle of the Panda's ranges, and of the iiwas'."""


def fourier(seed: int, t: Array, centre: Array) -> tuple[np.random.Generator, tuple[Array, ...]]:
    """A generator; angles, speeds and accelerations (T, 7) of five harmonics of 0.1 Hz."""
    rng = np.random.default_rng(seed)
    k = 2 * np.pi * 0.1 * np.arange(1, 6)
    a, b = rng.normal(size=(2, 5, 7)) / np.sqrt(np.arange(1, 6))[:, None]
    s, c = np.sin(np.outer(t, k)), np.cos(np.outer(t, k))
    q = s @ (a / k[:, None]) - c @ (b / k[:, None])
    size = 0.8 / np.abs(q).max(axis=0)
    v, acc = c @ a + s @ b, c @ (b * k[:, None]) - s @ (a * k[:, None])
    return rng, (centre + q * size, v * size, acc * size)


def inverse(robot: str, q: Array, dq: Array, ddq: Array) -> Array:
    """(T, n) torque of the bare arm."""
    model = load_arm(robot).model()
    model.dof_armature[:] = model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    return inverse_torque(model, q, dq, ddq)


def dahl(q: Array, level: float, stiffness: float) -> Array:
    """(T,) torque of a bristle that starts unloaded."""
    out = np.zeros(len(q))
    for i, way in enumerate(np.diff(q)):
        keep = np.exp(-abs(way) * stiffness / level)
        out[i + 1] = out[i] * keep + np.sign(way) * level * (1 - keep)
    return out


EFFECTS = {
    "waves": lambda q: np.cos(q + 0.3) - 0.5 * np.sin(2 * q),
    "hump": lambda q: np.exp(-0.5 * ((q - q.mean()) / 0.35) ** 2),
}
"""Torque [N·m] on a joint of angle (T,)."""


def plain_log(
    effect: str | None,
    *,
    robot: str = "panda",
    joint: int = 4,
    noise: float = 0.05,
    rate: float = 500.0,
    seconds: float = 20.0,
    seed: int = 0,
) -> JointLog:
    """One log with an effect of about 1 N·m on a joint (from 1), or none; torque has noise."""
    t = np.arange(0, seconds, 1 / rate)
    middle = CENTRE if robot == "panda" else MIDDLE
    rng, (q, v, a) = fourier(seed, t, middle)
    tau = inverse(robot, q, v, a)
    if effect:
        tau[:, joint - 1] += EFFECTS[effect](q[:, joint - 1])
    tau = tau + noise * rng.normal(size=q.shape)
    return JointLog(source=f"plain_{effect}.csv", t=t, q=q, dq=None, tau=tau)


def yielding(law: Callable[..., Array], level: float, distance: float, seed: int) -> Diagnosis:
    """Diagnose a log of small reversals, in which a law is hidden on joints 2, 4 and 6."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 20, 1 / 250)
    q = MOTIONS["reversals"](rng, t)
    v = np.gradient(q, t, axis=0)
    tau = inverse("panda", q, v, np.gradient(v, t, axis=0)) + 0.03 * rng.normal(size=q.shape)
    for j in (1, 3, 5):
        tau[:, j] += law(q[:, j], level, level / distance)
    return diagnose_logs([JointLog(source="yields.csv", t=t, q=q, dq=None, tau=tau)], "panda")


@pytest.mark.parametrize("distance", [0.04, pytest.param(0.06, marks=pytest.mark.slow)])
def test_joints_that_yield_far_are_named_with_their_stiffness(distance: float) -> None:
    """Dahl's friction that builds up over 40 or 60 mrad, in a log of small reversals."""
    found = yielding(dahl, 1.0, distance, seed=3)
    named = {c.name: c for c in found.causes}
    assert set(named) == {"coulomb_friction", "presliding_hysteresis"}
    assert named["presliding_hysteresis"].joints == (2, 4, 6)
    for parameters in named["presliding_hysteresis"].parameters.values():
        low, high = parameters["bristle_stiffness"].ci95
        assert low < 1.0 / distance < high
    assert found.verdict == "explained"


@pytest.mark.parametrize(("hidden", "joint"), [("waves", 4), ("hump", 2)])
def test_a_smooth_torque_over_the_angle_is_named(hidden: str, joint: int) -> None:
    """And what is found on the joint is the curve that was hidden, at the angles of the log."""
    found = diagnose_logs([plain_log(hidden, joint=joint, rate=250.0)], "panda")
    first = found.causes[0]
    assert (first.name, first.joints) == ("position_dependent_torque", (joint,))
    assert {j for c in found.causes for j in c.joints} == {joint}
    log = plain_log(hidden, joint=joint, rate=250.0, noise=0.0)
    rigid = plain_log(None, rate=250.0, noise=0.0)
    truth = np.interp(found.data.t, log.t, (log.tau - rigid.tau)[:, joint - 1])
    off = found.torque(joint - 1) - truth
    assert np.sqrt(np.mean(off**2)) < 0.1 * truth.std()


@pytest.mark.parametrize(
    ("robot", "noise", "rate", "seconds", "seed"),
    [
        ("panda", 0.01, 500.0, 12.0, 50),
        ("iiwa7", 0.05, 200.0, 20.0, 51),
        ("iiwa14", 0.5, 250.0, 15.0, 52),
    ],
)
def test_no_effect_is_no_discrepancy(
    robot: str, noise: float, rate: float, seconds: float, seed: int
) -> None:
    log = plain_log(None, robot=robot, noise=noise, rate=rate, seconds=seconds, seed=seed)
    found = diagnose_logs([log], robot)
    assert found.verdict == "no discrepancy"
    assert not found.causes


def test_a_constant_torque_about_a_vertical_axis_is_no_body() -> None:
    """Only joint 1 turns, so that gravity never changes: an offset at most is named.

    1 N·m is as much as small errors of the links hold.
    """
    log = plain_log(None, robot="iiwa7", rate=200.0, seconds=10.0)
    q = np.tile(MIDDLE, (len(log.q), 1))
    q[:, 0] = log.q[:, 0]
    v = np.gradient(q, log.t, axis=0)
    tau = inverse("iiwa7", q, v, np.gradient(v, log.t, axis=0))
    tau[:, 1] += 1.0
    rng = np.random.default_rng(0)
    found = diagnose_logs([replace(log, q=q, tau=tau + 0.02 * rng.normal(size=q.shape))], "iiwa7")
    assert {c.name for c in found.causes} <= {"torque_offset"}
