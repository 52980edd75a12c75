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
from stiction_envs.friction.parameters import load_friction
from stiction_envs.robots import load_arm
from tests.friction.gyro import law_of, sticking

H = 1e-3


def torque(c: Compensation, state: np.ndarray | None = None, **values: float) -> float:
    """Torque of the first joint by the law of ``c``, which sees ``values`` and 0 besides."""
    state, seen = np.zeros(1) if state is None else state, np.zeros(base.SEEN)
    for name, value in values.items():
        seen[getattr(base, name)] = value
    return LAWS[c.kind].torque(c.packed()[0], seen, state, H)


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


def test_lugre_observer_is_the_law_of_friction():
    """Force and deflection of every cycle, at speeds of both directions."""
    model = sticking(viscous=0.2)
    law, p = law_of(model, 0), model.parameters
    c = Compensation.from_friction("lugre_observer", p)
    c = c.replace(damping=model.bristle_damping_of(p), injection=0.0)
    state, z = np.zeros(1), 0.0
    for speed in 0.2 * np.sin(0.003 * np.arange(4000)) ** 3:
        force = torque(c, state, SPEED=speed)
        assert force == pytest.approx(law.torque(z, speed), rel=1e-9, abs=1e-12)
        z = law.advance(z, speed, H)
        assert state[0] == pytest.approx(z, rel=1e-9, abs=1e-15)
    assert abs(z) > 0.5 * c.gain[0] / c.numbers["stiffness"][0]


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
