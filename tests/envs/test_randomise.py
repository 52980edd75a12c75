"""Domain randomisation and robot senses: what varies, and that nothing else does."""

import numpy as np
import pytest

from stiction_envs.control.sensing import Sensing
from stiction_envs.envs.gte import GTEEnv
from stiction_envs.experiments.randomise import FIELDS, randomised
from stiction_envs.friction.parameters import load_friction
from tests.envs.helpers import GTE, TRIANGLE, episode, mild, quiet, same
from tests.refusal import refusal

SPREADS = {"friction": 0.2, "rotor": 0.2, "bristles": 0.3, "load": 0.5}


def test_no_spread_is_the_nominal_arm_bit_for_bit(kind):
    runs = []
    for randomise in (None, {}, {"friction": 0.0, "load": 0}):
        env = kind.make(randomise=randomise)
        runs.append(episode(env, mild(env, 6), seed=3, options=kind.options))
        runs[-1].append(env.reset())  # the stream goes on alike
    assert same(runs[0], runs[1])
    assert same(runs[0], runs[2])


def undithered(**arguments) -> tuple[GTEEnv, dict]:
    """Return an environment, and the last info of its episode without dither."""
    env = GTEEnv(**GTE.arguments, **arguments)
    return env, episode(env, quiet(env), seed=2, options=TRIANGLE)[-1][4]


def test_a_randomised_arm_is_an_arm_of_that_friction_bit_for_bit():
    """Only the unit of its reward is another's."""
    env, final = undithered(randomise={"friction": 0.5, "load": 0.5})
    names, plant = ("stiction", "load_coefficient"), env.core.rig.plant
    own = env.core._nominal.replace(**{k: plant._p[k][0] for k in names})
    (_, other), (_, usual) = undithered(friction=own), undithered()
    for name in ("error", "error_left", "shaking", "duration"):
        assert np.array_equal(final[name], other[name]), name
    assert np.array_equal(final["undithered_error"], usual["undithered_error"])
    assert not np.array_equal(final["error"], usual["error"])
    assert not np.array_equal(final["undithered_error"], other["undithered_error"])


def test_factors_stay_within_their_spread_and_differ_by_joint():
    p = load_friction("panda")
    drawn = np.random.default_rng(1).uniform(-1.0, 1.0, (400, len(FIELDS), 7))
    out = randomised(p, SPREADS, drawn)
    quantities = {"friction": "stiction", "rotor": "rotor_inertia", "bristles": "bristle_stiffness"}
    for name, field in quantities.items():
        ratio = getattr(out, field) / getattr(p, field)
        ratio = ratio[..., 0] if ratio.ndim == 3 else ratio
        assert ratio.min() == pytest.approx(1 - SPREADS[name], abs=0.02)
        assert ratio.max() == pytest.approx(1 + SPREADS[name], abs=0.02)
        assert ratio.mean() == pytest.approx(1, abs=0.02)
        assert np.abs(np.corrcoef(ratio.T) - np.eye(7)).max() < 0.2, "joint by joint"
    # load-dependent friction is friction, too
    load = out.load_coefficient / p.load_coefficient / (out.stiction / p.stiction)[..., 0]
    assert load.min() == pytest.approx(0.5, abs=0.02)
    for field in ("viscous", "coulomb_ratio", "stribeck_velocity", "offset", "joint_stiffness"):
        assert np.array_equal(getattr(out, field)[7], getattr(p, field)), field


@pytest.mark.parametrize(
    ("randomise", "words"),
    [
        ({"mass": 0.1}, "spread to randomise 'mass': expected one of friction, rotor, bristles"),
        ({"friction": 1.0}, "randomise friction is 1.0: expected `float` < 1"),
        ({"friction": float("nan")}, "randomise friction is nan"),
        ({"friction": "a"}, "randomise friction is 'a'"),
        ({"rotor": 0.999, "bristles": 0.9}, "randomise .*bristle"),
        (0.2, "randomise is a float: expected a dict"),
    ],
)
def test_wrong_spreads(kind, randomise, words):
    refusal(lambda: kind.single(randomise=randomise), words)


@pytest.mark.parametrize("factor", [0, float("nan"), "much"])
def test_friction_factors_that_are_none(factor):
    refusal(lambda: GTEEnv(friction_factor=factor, **GTE.arguments), "friction_factor")


OFF = Sensing(angle_noise=1e-3, speed_noise=0.01, measurement_delay=0.002, missed_cycles=0.1)


def test_the_observation_is_what_was_read(kind):
    env = kind.make(sensing=OFF)
    env.reset(seed=3, options=kind.options)
    seen, *_ = env.step(mild(env, 6))
    core = env.unwrapped.core
    rig, names = core.rig, list(core.observation_names)
    origin = rig.start if hasattr(rig, "start") else rig.pose[0]
    unit = 1.0 if hasattr(rig, "start") else rig.protocol.threshold
    first = [k for k, name in enumerate(names) if name.startswith("displacement")]
    expected = (rig.senses.q[0] - origin) / unit
    assert seen[first] == pytest.approx(expected.astype(np.float32))
    assert np.abs(rig.senses.q[0] - rig.plant.position[0]).max() > 1e-4
