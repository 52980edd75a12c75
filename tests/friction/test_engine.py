"""MuJoCo's joint against the numpy law: both must be the same joint. sources.md 3.5, 4.5."""

import numpy as np
import pytest

from stiction_envs.friction.model import StickingModel
from stiction_envs.plant import Plant
from tests.friction.gyro import ARM, J_A, MASS, law_of, pendulum, sticking
from tests.hidden.one_joint import simulate_joint

A, B = 0, 1
DT = 1e-3
FINE = 20
"""Steps of the 0.05 ms reference per control step."""


def command(torque: np.ndarray, joint: int = A) -> np.ndarray:
    """(1, K, 2) torque on one joint."""
    out = np.zeros((1, len(torque), 2))
    out[0, :, joint] = torque
    return out


def run(model: StickingModel, torque: np.ndarray, joint: int = A) -> np.ndarray:
    """Angle (K,) of one joint under a torque (K,)."""
    return Plant(model, 1, threads=1).run(command(torque, joint))[0, :, joint]


def shake(rate: float = 0.3, amplitude: float = 0.2, hz: float = 15.0, time: float = 2.5):
    """A ramp with dither on it [N·m], through presliding, breakaway and sliding."""
    t = np.arange(round(time / DT)) * DT
    return rate * t + amplitude * np.sin(2 * np.pi * hz * t)


def slide(
    model: StickingModel, joint: int, v: float, *, start: float = 0.0, time: float
) -> tuple[np.ndarray, np.ndarray]:
    """Drag one joint with a servo at v [rad/s] for some time [s]; return its angle and torque.

    ``start`` is the angle of joint b [rad].
    """
    path = v * DT * np.arange(round(time / DT))
    plant = Plant(model, 1, threads=1)
    q0 = np.zeros((1, 2))
    q0[0, B] = start
    plant.reset(np.arange(1), q0)
    kp, kv = 400.0, 60.0
    plant.set_servo(np.arange(1), np.full((1, 2), kp), np.full((1, 2), kv), q0)
    setpoint = np.tile(q0[:, None], (1, len(path), 1))
    setpoint[0, :, joint] += path
    q = plant.run(np.zeros((1, len(path), 2)), setpoint=setpoint)[0, :, joint]
    before = np.concatenate([[q0[0, joint]], q[:-1]])
    speed = np.diff(before, prepend=before[0]) / DT
    return before, kp * (setpoint[0, :, joint] - before) - kv * speed


@pytest.mark.parametrize("joint", [A, B])
def test_engine_is_the_law_at_the_same_step(joint):
    """Without σ2 MuJoCo's Euler step is the reference's, to rounding."""
    model = sticking()
    plant = Plant(model, 1, threads=1)
    torque = shake(time=3.5)
    q = plant.run(command(torque, joint))[0, :, joint]
    inertia = model.friction_inertia[joint]
    ref, z = simulate_joint(law_of(model, joint), torque, dt=DT, inertia=inertia)
    assert np.abs(ref).max() > 1.0  # far beyond breakaway
    np.testing.assert_allclose(q, ref, rtol=0, atol=1e-11)
    np.testing.assert_allclose(plant.bristle[0, joint], z[-1], rtol=0, atol=1e-14)


SPRING = {"rotor_inertia": 0.1, "stiction": 0.8}


@pytest.mark.parametrize(
    ("changes", "profile"),
    [
        ({}, (0.2, 0.2, 15.0)),
        (SPRING | {"joint_stiffness": [2e3, np.inf]}, (0.4, 0.3, 30.0)),
        (SPRING | {"joint_stiffness": [1e4, np.inf]}, (0.4, 0.3, 30.0)),
    ],
    ids=["rigid", "soft", "stiff"],
)
def test_dithered_ramp_against_the_fine_reference(changes, profile):
    """At 1 ms the joint, rigid or on a spring, breaks away where the 0.05 ms reference does.

    In presliding, under dither, a 1 ms step is a few per cent off; that shrinks with the step.
    """
    torque = shake(*profile, time=3.6)
    model = sticking(**changes, viscous=0.1)
    p = model.parameters
    stiffness, rotor = float(p.joint_stiffness[A]), float(p.rotor_inertia[A])
    spring = {}
    if np.isfinite(stiffness):
        damping = 2 * 0.15 * np.sqrt(stiffness * rotor)
        spring = {"stiffness": stiffness, "link_inertia": J_A, "damping": damping}
    ref, _ = simulate_joint(
        law_of(model, A),
        np.repeat(torque, FINE),
        dt=DT / FINE,
        inertia=model.friction_inertia[A],
        **spring,
    )
    ref = ref[FINE - 1 :: FINE]
    away = int(np.argmax(ref > 0.15))
    assert away > 1500
    early, errors = slice(0, 1500), []
    for timestep in (1e-3, 2.5e-4):
        q = run(sticking(**changes, viscous=0.1, timestep=timestep), torque)
        assert int(np.argmax(q > 0.15)) == pytest.approx(away, rel=2e-3)
        errors.append(np.abs(q[early] - ref[early]).max() / np.abs(ref[early]).max())
    assert errors[0] < 0.1
    assert errors[1] < 0.4 * errors[0]


ASYMMETRIC = {
    "stiction": [0.6, 0.9],
    "coulomb_ratio": [0.8, 0.7],
    "stribeck_velocity": [0.02, 0.03],
    "viscous": [0.3, 0.1],
}


@pytest.mark.parametrize("v", [0.005, 0.1])
@pytest.mark.parametrize("sign", [1, -1])
def test_steady_sliding_torque(v, sign):
    """Dragged at v the joint asks for g(v) + σ2 v, of its own direction."""
    model = sticking(**ASYMMETRIC)
    _, torque = slide(model, A, sign * v, time=max(1.5, 0.01 / v))
    law = law_of(model, A, side=0 if sign > 0 else 1)
    assert torque[-200:].mean() == pytest.approx(sign * law.steady(v), rel=2e-3)


@pytest.mark.parametrize("pose", [0.0, 1.0])
def test_bearing_load_lifts_friction(pose):
    """Joint a, vertical, sees no gravity torque: its load is the moment m g r |sin q_b| across."""
    model = sticking(pendulum(), load_coefficient=[0.05, 0.0], load_high=np.inf, coulomb_ratio=0.9)
    assert model.bearing.tolist() == [True, False]
    load = MASS * 9.81 * ARM * np.sin(pose)
    _, torque = slide(model, A, 0.05, start=pose, time=2.0)
    law = law_of(model, A, load=load)
    assert torque[-200:].mean() == pytest.approx(law.steady(0.05), rel=3e-3)


@pytest.mark.parametrize(("low", "high"), [(0.0, np.inf), (6.0, 8.0)])
def test_gravity_load_lifts_friction_as_it_moves(low, high):
    """Joint b carries m g r sin q: its friction follows that, clipped to [load_low, load_high]."""
    model = sticking(
        pendulum(), load_coefficient=[0.0, 0.05], load_low=low, load_high=high, coulomb_ratio=0.9
    )
    v = 0.2
    q, torque = slide(model, B, v, start=0.1, time=7.0)
    late = slice(1000, None, 200)
    loads = np.clip(MASS * 9.81 * ARM * np.abs(np.sin(q[late])), low, high)
    expected = [law_of(model, B, load=load).steady(v) for load in loads]
    # load is refreshed every 20 ms; the servo adds a little dynamics
    np.testing.assert_allclose(torque[late], expected, rtol=0.01)
    assert max(expected) > 1.1 * min(expected)


@pytest.mark.parametrize(("sign", "stiction"), [(1, 0.6), (-1, 0.9)])
def test_a_joint_stands_and_goes_by_the_level_of_its_direction(sign, stiction):
    """90 % of F_s bends the bristle by −ln(0.1) F_s/σ0 and then stands; 110 % goes."""
    rise = sign * stiction * np.clip(shake(0.2, 0, 1, 20), 0, 1)
    stands, goes = (sign * run(sticking(**ASYMMETRIC), factor * rise) for factor in (0.9, 1.1))
    assert np.ptp(stands[-10_000:]) < 1e-9
    assert stands[-1] == pytest.approx(-np.log(0.1) * stiction / 1000.0, rel=0.06)
    assert goes[-1] > 0.1


@pytest.mark.parametrize("seed", range(2))
def test_passive(seed):
    """With σ2 above the bound friction never gives back more than its bristle holds.

    Work of the motor − gain of kinetic and bristle energy is what friction has taken; for
    M = const the semi-implicit step makes that balance exact: work is τ (v + v⁺)/2.
    """
    bound = 2 * 0.4 * np.sqrt(1000.0 * (J_A + 0.05)) * (1 - 0.8) / 0.8
    model = sticking(viscous=1.05 * bound)
    rng = np.random.default_rng(seed)
    k = 4000
    t = np.arange(k) * DT
    waves = [a * np.sin(2 * np.pi * f * t + p) for a, f, p in rng.uniform(0, [0.5, 30, 6], (6, 3))]
    torque = np.sum(waves, axis=0) * (t < 3.0)
    plant = Plant(model, 1, threads=1)
    q, z = np.empty(k), np.empty(k)
    for i in range(k):
        q[i] = plant.run(command(torque[i : i + 1]))[0, 0, A]
        z[i] = plant.bristle[0, A]
    v = np.diff(np.concatenate([[0.0], q])) / DT
    work = np.cumsum(torque * (v + np.concatenate([[0.0], v[:-1]])) / 2 * DT)
    taken = work - (J_A + 0.05) * v**2 / 2 - 1000.0 * z**2 / 2
    scale = work.max()
    assert scale > 0.01
    assert np.diff(taken[::20]).min() > -1e-3 * scale
    assert taken[-1] > 0.5 * work[-1]


def test_link_torque_goes_through_the_spring():
    """A torque on the link twists the spring by τ/K while the motor stands by its friction."""
    model = sticking(joint_stiffness=[5e3, np.inf], offset=[0.2, 0.0])
    plant = Plant(model, 1, threads=1)
    plant.run(np.zeros((1, 3000, 2)))
    twist = plant.position[0, A] - plant.motor_position[0, A]
    assert twist == pytest.approx(-0.2 / 5e3, rel=1e-3)
    assert 0.2 / 1000.0 < -plant.motor_position[0, A] < 2 * 0.6 / 1000.0
