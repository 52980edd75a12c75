"""Causes as textbooks write them, in logs as somebody else would simulate them.

Nothing in these logs comes from the package but the arms' MJCF: angles, speeds and accelerations
are analytic, the torque is ``mj_inverse`` of the nominal arm, the effect is the textbook's formula,
the noise is white.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.judge.judgement import NamedCause
from stiction_envs.hidden.hidden_motions import MOTIONS
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


def inverse(
    robot: str,
    q: Array,
    dq: Array,
    ddq: Array,
    *,
    payload: tuple[float, Array] | None = None,
    tilt: tuple[float, float] = (0.0, 0.0),
    link: tuple[int, float, Array] | None = None,
) -> Array:
    """(T, n) torque of the arm, of a sphere at its flange, on a base that leans.

    A link (from 1) may have another mass [kg] and centre [m], each as a difference; its density
    changes evenly.
    """
    spec = load_arm(robot).spec()
    if link is not None:
        body = list(spec.joints)[link[0] - 1].parent
        share = 1 + link[1] / body.mass
        body.fullinertia, body.inertia = body.fullinertia * share, body.inertia * share
        body.mass, body.ipos = body.mass * share, body.ipos + link[2]
    lean, towards = tilt
    side = np.sin(lean) * np.array([np.cos(towards), np.sin(towards)])
    spec.option.gravity = 9.81 * np.array([*side, -np.cos(lean)])
    if payload is not None:
        site = next(x for x in spec.sites if x.name == "flange")
        load = site.parent.add_body(name="load", pos=site.pos, quat=site.quat)
        load.mass, load.ipos = payload
        load.inertia = [0.4 * payload[0] * 0.03**2] * 3
        load.explicitinertial = True
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model = spec.compile()
    model.dof_armature[:] = model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    data = mujoco.MjData(model)
    out = np.empty_like(q)
    for i in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[i], dq[i], ddq[i]
        mujoco.mj_inverse(model, data)
        out[i] = data.qfrc_inverse
    return out


def dahl(q: Array, level: float, stiffness: float) -> Array:
    """(T,) torque of a bristle that starts unloaded."""
    out = np.zeros(len(q))
    for i, way in enumerate(np.diff(q)):
        keep = np.exp(-abs(way) * stiffness / level)
        out[i + 1] = out[i] * keep + np.sign(way) * level * (1 - keep)
    return out


def gms(q: Array, level: float, stiffness: float) -> Array:
    """(T,) torque of forty Maxwell-slip elements that start unloaded, and slide one by one.

    Their virgin curve is 1 − e^(−2x/d), d = level/stiffness: after a full reversal that of `dahl`.
    """
    distance = level / stiffness
    strength = np.diff(1 - (1 + np.linspace(0, 6, 41) * 2) * np.exp(-2 * np.linspace(0, 6, 41)))
    yields = distance * (np.arange(40) + 0.5) * 6 / 40
    out, at = np.zeros(len(q)), np.zeros(40)
    for i, way in enumerate(np.diff(q)):
        at = np.clip(at + way / yields, -1, 1)
        out[i + 1] = level * (strength @ at) / strength.sum()
    return out


EFFECTS = {
    "coulomb_friction": lambda q, v, a, n, t: np.sign(v),
    "viscous_friction": lambda q, v, a, n, t: v,
    "stribeck_friction": lambda q, v, a, n, t: np.sign(v) * (1 + np.exp(-((v / 0.1) ** 2))),
    "stribeck_alone": lambda q, v, a, n, t: np.sign(v) * np.exp(-((v / 0.1) ** 2)),
    "direction_asymmetry": lambda q, v, a, n, t: np.where(v > 0, 1.4, -0.6),
    "load_dependent_friction": lambda q, v, a, n, t: np.sign(v) * (0.5 + 0.1 * np.abs(n)),
    "load_alone": lambda q, v, a, n, t: np.sign(v) * 0.1 * np.abs(n),
    "presliding_hysteresis": lambda q, v, a, n, t: dahl(q, 1.0, 1 / 0.02),
    "position_dependent_friction": lambda q, v, a, n, t: np.sin(20 * q + 0.4),
    "warm_up_drift": lambda q, v, a, n, t: np.sign(v) * (1 - 0.02 * t),
    "torque_offset": lambda q, v, a, n, t: np.ones_like(q),
    "torque_scale": lambda q, v, a, n, t: 0.1 * n,
    "link_inertia": lambda q, v, a, n, t: 0.4 * a,
    "smooth_waves": lambda q, v, a, n, t: np.cos(q + 0.3) - 0.5 * np.sin(2 * q),
    "smooth_hump": lambda q, v, a, n, t: np.exp(-0.5 * ((q - q.mean()) / 0.35) ** 2),
    "external_spring": lambda q, v, a, n, t: 3 * (q - 0.2),
}
"""Torque [N·m] on a joint of angle, speed, acceleration, rigid torque and time, (T,) each."""


def plain_log(
    cause: str | None,
    *,
    robot: str = "panda",
    joints: tuple[int, ...] = (4,),
    size: float = 1.0,
    noise: float = 0.05,
    rate: float = 500.0,
    seconds: float = 20.0,
    seed: int = 0,
    angle_noise: float = 0.0,
) -> JointLog:
    """One log with one cause of about 1 N·m times ``size``, or none.

    ``joints`` are those from 1 where it acts, or the link; noise of torque [N·m] and angle [rad].
    """
    t = np.arange(0, seconds, 1 / rate)
    middle = CENTRE if robot == "panda" else MIDDLE
    rng, (q, v, a) = fourier(seed, t, middle)
    link = (joints[0], 0.5, np.array([0.005, -0.005, 0.003]))
    tau = inverse(
        robot,
        *(fourier(seed, t + 0.01, middle)[1] if cause == "actuator_delay" else (q, v, a)),
        payload=(1.0, np.array([0.02, 0.0, 0.05])) if cause == "payload" else None,
        tilt=(0.05, 0.7) if cause == "base_tilt" else (0.0, 0.0),
        link=link if cause == "link_parameters" else None,
    )
    rigid = tau.copy()
    for j in (x - 1 for x in joints if cause in EFFECTS):
        tau[:, j] += size * EFFECTS[cause](q[:, j], v[:, j], a[:, j], rigid[:, j], t)
    if cause == "joint_elasticity":
        bent = q.copy()
        for j in (x - 1 for x in joints):
            bent[:, j] -= rigid[:, j] / 2000.0
        speed = np.gradient(bent - q, 1 / rate, axis=0)
        tau = inverse(robot, bent, v + speed, a + np.gradient(speed, 1 / rate, axis=0))
    if cause == "encoder_offset":
        q = q + 0.05 * np.isin(np.arange(1, 8), joints)
    if cause == "gravity_compensation_missing":
        tau = tau - size * inverse(robot, q, np.zeros_like(q), np.zeros_like(q))
    q = q + angle_noise * rng.normal(size=q.shape)
    tau = tau + noise * rng.normal(size=q.shape)
    return JointLog(source=f"plain_{cause}.csv", t=t, q=q, dq=None, tau=tau)


def solved(cause: str | None, robot: str = "panda", **options) -> Diagnosis:
    """Diagnose a log; an arm with a hand of 0.7 kg where that is what is wrong."""
    hand = (0.7, -0.01, 0.0, 0.03) if cause == "phantom_payload" else None
    log = plain_log(cause, robot=robot, **options)
    return diagnose_logs([log], load_arm(robot, payload=hand))


def value(named: NamedCause, joint: int, key: str) -> float:
    return float(np.ravel(named.parameters[joint][key].value)[0])


# hidden, what is named first, and one of its parameters
FIRST = [
    ("coulomb_friction", "coulomb_friction", "coulomb_nm", 1.0),
    ("viscous_friction", "viscous_friction", "viscous_nms", 1.0),
    ("stribeck_friction", "coulomb_friction", "coulomb_nm", 1.0),
    ("stribeck_alone", "stribeck_friction", "stribeck_velocity", 0.1),
    ("direction_asymmetry", "coulomb_friction", "coulomb_nm", 1.0),
    ("load_dependent_friction", "load_dependent_friction", "load_coefficient", 0.1),
    ("load_alone", "load_dependent_friction", "load_coefficient", 0.1),
    ("presliding_hysteresis", "coulomb_friction", "coulomb_nm", 1.0),
    ("position_dependent_friction", "position_dependent_friction", "periods_per_rev", 20.0),
    ("warm_up_drift", "coulomb_friction", "coulomb_nm", 1.0),
    ("torque_offset", "torque_offset", "offset_nm", 1.0),
    ("torque_scale", "torque_scale", "scale", 1.1),
    ("payload", "payload", "mass_kg", 1.0),
    ("base_tilt", "base_tilt", "tilt_rad", 0.05),
    ("link_inertia", "link_inertia", "armature_kgm2", 0.4),
    ("joint_elasticity", "joint_elasticity", "stiffness_nm_per_rad", 2000.0),
    ("actuator_delay", "actuator_delay", "delay_s", 0.01),
    ("encoder_offset", "encoder_offset", "offset_rad", 0.05),
    ("gravity_compensation_missing", "gravity_compensation_missing", "share", 1.0),
    ("external_spring", "external_spring", "stiffness_nm_per_rad", 3.0),
]
BESIDE = ("stribeck_friction", "presliding_hysteresis", "warm_up_drift")
"""Hidden together with dry friction, and named too."""


@pytest.mark.parametrize(("hidden", "first", "key", "truth"), FIRST, ids=lambda x: str(x))
def test_a_textbook_effect_is_named(hidden: str, first: str, key: str, truth: float) -> None:
    found = solved(hidden, rate=250.0)
    named = {c.name: c for c in found.causes}
    assert found.causes[0].name == first
    joint = 0 if 0 in named[first].parameters else 4
    assert np.isclose(value(named[first], joint, key), truth, rtol=0.2)
    if hidden in BESIDE:
        assert hidden in named
    assert found.verdict == "explained"


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


@pytest.mark.parametrize("law", [dahl, gms], ids=["dahl", "gms"])
def test_the_law_of_presliding_is_named(law) -> None:
    """One bristle or forty elements, of which the diagnosis has eight, on joints 2, 4 and 6."""
    found = yielding(law, 0.8, 0.015, seed=4)
    named = {c.name: c for c in found.causes}
    assert set(named) == {"coulomb_friction", "presliding_hysteresis"}
    presliding = named["presliding_hysteresis"]
    assert presliding.joints == (2, 4, 6)
    for parameters in presliding.parameters.values():
        assert parameters["elements"].value == (8 if law is gms else 1)
        assert parameters["bristle_stiffness"].value == pytest.approx(0.8 / 0.015, rel=0.1)
    assert ("GMS" in presliding.evidence) == (law is gms)
    assert found.verdict == "explained"


@pytest.mark.parametrize(("hidden", "joint"), [("smooth_waves", 4), ("smooth_hump", 2)])
def test_a_smooth_torque_over_the_angle_is_named(hidden: str, joint: int) -> None:
    """And what is found on the joint is the curve that was hidden, at the angles of the log."""
    found = solved(hidden, joints=(joint,), rate=250.0)
    first = found.causes[0]
    assert (first.name, first.joints) == ("position_dependent_torque", (joint,))
    assert {j for c in found.causes for j in c.joints} == {joint}
    log = plain_log(hidden, joints=(joint,), rate=250.0, noise=0.0)
    rigid = plain_log(None, rate=250.0, noise=0.0)
    truth = np.interp(found.data.t, log.t, (log.tau - rigid.tau)[:, joint - 1])
    off = found.torque(joint - 1) - truth
    assert np.sqrt(np.mean(off**2)) < 0.1 * truth.std()


def test_a_wrong_link_is_named() -> None:
    found = solved("link_parameters", joints=(4,), rate=250.0)
    assert found.causes[0].name == "link_parameters"


def test_a_hand_that_is_not_there_is_a_payload_of_negative_mass() -> None:
    found = solved("phantom_payload", rate=250.0)
    assert found.causes[0].name == "payload"
    assert value(found.causes[0], 0, "mass_kg") == pytest.approx(-0.7, rel=0.1)


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
    found = solved(None, robot, noise=noise, rate=rate, seconds=seconds, seed=seed)
    assert found.verdict == "no discrepancy"
    assert not found.causes


def test_friction_of_all_joints_is_named_on_all_joints() -> None:
    joints = (1, 2, 3, 4, 5, 6, 7)
    found = solved("coulomb_friction", joints=joints, size=0.4, rate=250.0, angle_noise=1e-5)
    assert [c.name for c in found.causes] == ["coulomb_friction"]
    assert found.causes[0].joints == joints


def test_a_constant_torque_about_a_vertical_axis_is_an_offset() -> None:
    """Only joint 1 turns, so that gravity never changes: neither payload nor tilt is named."""
    log = plain_log(None, robot="iiwa7", rate=200.0, seconds=10.0)
    q = np.tile(MIDDLE, (len(log.q), 1))
    q[:, 0] = log.q[:, 0]
    v = np.gradient(q, log.t, axis=0)
    tau = inverse("iiwa7", q, v, np.gradient(v, log.t, axis=0))
    tau[:, 1] += 1.0
    rng = np.random.default_rng(0)
    found = diagnose_logs([replace(log, q=q, tau=tau + 0.02 * rng.normal(size=q.shape))], "iiwa7")
    assert {c.name for c in found.causes} == {"torque_offset"}
