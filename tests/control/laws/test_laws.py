"""Laws of friction compensation: their formulas, and joints whose friction they take away."""

import ctypes

import numpy as np
import pytest

from stiction_envs.control.compensation import (
    Compensation,
    Compensations,
    Compensator,
    compensate,
)
from stiction_envs.control.impedance import CartesianImpedance, ImpedanceSettings
from stiction_envs.control.laws import LAWS, base
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import load_friction
from stiction_envs.plant import Plant
from stiction_envs.robots import load_arm

H = 1e-3
JOINT = 6


def torque(
    c: Compensation, state: np.ndarray | None = None, joint: int = 0, **values: float
) -> float:
    """Torque of a joint (from 0) by the law of ``c``, which sees ``values`` and 0 besides."""
    state, seen = np.zeros(1) if state is None else state, np.zeros(base.SEEN)
    for name, value in values.items():
        seen[getattr(base, name)] = value
    return LAWS[c.kind].torque(c.packed()[joint], seen, state, H)


def of(kind: str, **numbers: float) -> Compensation:
    return Compensation(kind=kind, **{name: (x,) for name, x in numbers.items()})


def one_arm(c: Compensation) -> Compensations:
    compensator = Compensator(1, 7, damping=0.2)
    compensator.set_rows(np.array([0]), [c])
    return compensator.arrays


@pytest.mark.parametrize("kind", LAWS)
def test_machine_code_of_a_law_is_its_formula(kind):
    """The code that the loop calls computes what the law's file states."""
    rng, law = np.random.default_rng(0), LAWS[kind]
    for _ in range(20):
        numbers, seen = rng.uniform(0.1, 2.0, 8), rng.normal(size=base.SEEN)
        states = np.array([0.1]), np.array([0.1])
        given = (x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in (numbers, seen))
        memory = states[0].ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        got = law.code.ctypes(*given, memory, H)
        assert got == pytest.approx(law.torque(numbers, seen, states[1], H), rel=1e-14)
        assert states[0] == pytest.approx(states[1], rel=1e-14)


@pytest.mark.parametrize("kind", LAWS)
def test_law_owns_its_numbers(kind):
    """Columns have different names; numbers that friction does not give have defaults."""
    law = LAWS[kind]
    names = [f.name for f in law.fields]
    assert law.name == kind
    assert len({f.column for f in law.fields}) == len(names)
    assert set(law.searched) <= set(names)
    c = Compensation.from_friction(kind, load_friction("panda", 7))
    assert {name: len(x) for name, x in c.numbers.items()} == dict.fromkeys(names, 7)


@pytest.mark.parametrize("kind", LAWS)
def test_gain_zero_is_nothing(kind):
    a = one_arm(Compensation.from_friction(kind, load_friction("panda", 7), 0.0))
    assert a.law[0] == 0
    assert not a.feeds[0]
    assert not a.reads_model[0]


def test_push_grows_with_the_load():
    c = of("push", gain=0.5, load=0.1)
    free, loaded = torque(c, ERROR=1.0), torque(c, ERROR=1.0, GRAVITY=-20.0)
    assert loaded - free == pytest.approx(2.0, rel=1e-12)
    assert torque(c.replace(load=0.0), ERROR=1.0, GRAVITY=-20.0) == free


def sliding_joint() -> tuple[Plant, Compensation]:
    """The Panda with a rigid joint 7, all of whose friction the observer knows."""
    zero = np.zeros(7)
    friction = load_friction("panda", 7).rigid()
    friction = friction.replace(
        load_coefficient=zero,
        ripple_amplitude=zero,
        offset=zero,
        gravity_error=zero,
        stiction=np.repeat(friction.stiction.mean(axis=1, keepdims=True), 2, axis=1),
        coulomb_ratio=np.full((7, 2), 0.7),
        viscous=np.full((7, 2), 0.2),
    )
    sticking = build(load_arm("panda"), friction)
    c = Compensation.from_friction("lugre_observer", friction)
    c = c.replace(damping=sticking.bristle_damping_of(friction), injection=0.0)
    return Plant(sticking, 1), c


def test_lugre_observer_is_the_plants_bristle_in_steady_sliding():
    """Started at 0 while the joint slides, it comes to the plant's deflection and its force."""
    plant, c = sliding_joint()
    speed, start, state, found = 0.2, plant.position[0, JOINT], np.array([0.0]), []

    def law() -> np.ndarray:
        out, t = np.zeros((1, 7)), H * len(found)
        q, dq = plant.position[0, JOINT], plant.velocity[0, JOINT]
        out[0, JOINT] = 400 * (start + speed * t - q) + 20 * (speed - dq)
        force = torque(c, state, joint=JOINT, SPEED=dq) if t >= 1.0 else 0.0
        found.append((out[0, JOINT], force, state[0] - plant.bristle[0, JOINT]))
        return out

    for _ in range(4000):
        plant.run(law()[None])
    applied, force, off = np.array(found).T
    assert abs(off[1000]) > 0.2 * c.gain[JOINT] / c.numbers["stiffness"][JOINT]
    assert abs(off[-1]) < 1e-3 * c.gain[JOINT] / c.numbers["stiffness"][JOINT]
    assert force[-1] == pytest.approx(applied[-1], rel=1e-3)
    assert force[-1] == pytest.approx(0.7 * c.gain[JOINT] + 0.2 * speed, rel=0.01)


def test_lugre_observer_integrates_the_error_up_to_stiction():
    """A joint that rests with an error: k σ0 e per second, at most F_s."""
    c = of("lugre_observer", gain=1.0, coulomb=0.7, speed=0.1, stiffness=1000.0, injection=2.0)
    state = np.zeros(1)
    torques = [torque(c, state, ERROR=0.001) for _ in range(2000)]
    # the force of a cycle is that of the deflection before it, as in the plant
    np.testing.assert_allclose(torques[:400], 2.0 * np.arange(400) * H, atol=1e-12)
    assert torques[-1] == pytest.approx(1.0, rel=1e-12)
    assert state[0] == 1.0 / 1000.0


def test_momentum_observer_follows_a_disturbance_with_its_time_constant():
    """M q̈ = τ + d of seven coupled joints: r(t) = d (1 − e^(−K t)), to rounding."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(7, 7))
    mass, d = root @ root.T + np.eye(7), rng.normal(size=7)
    c = Compensation(kind="momentum_observer", gain=(100.0,) * 7, rate=(40.0,), share=(1.0,))
    found = one_arm(c)
    impedance = CartesianImpedance(ImpedanceSettings(), 1, load_arm("panda").limits).arrays
    pose = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 6, 7))
    coriolis, dq = rng.normal(size=7), np.zeros((1, 7))
    found.coriolis[0] = coriolis
    for k in range(60):
        command = impedance.command[0] = rng.normal(size=7)
        dq = dq + H * np.linalg.solve(mass, command - coriolis + d)
        compensate(0, *pose, dq, mass[None], impedance, found)
        expected = d * -np.expm1(-40.0 * H * (k + 1))
        np.testing.assert_allclose(found.torque[0], -expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_momentum_observer_amplifies_what_pushes_a_joint_at_rest(share):
    """Stuck: friction equals the command, which grows to 1/(1 − s) of it, but by no more than g."""
    for push, gain in ((0.1, 10.0), (3.0, 1.0)):
        c = of("momentum_observer", gain=gain, share=share)
        state, command = np.zeros(1), 0.0
        for _ in range(5000):
            command = push + torque(c, state, TORQUE=command)
        assert command == pytest.approx(push + min(share * push / (1 - share), share * gain))
