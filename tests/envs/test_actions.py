"""The action space ``dither+push``: limit cases, bits of batches and threads, what is refused."""

from __future__ import annotations

import dataclasses
import re

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.control.compensation import Compensation
from stiction_envs.control.compensation_files import write_compensation
from stiction_envs.envs.agents import AGENTS
from stiction_envs.envs.gte import GTEEnv, GTEVectorEnv
from stiction_envs.errors import StictionError
from stiction_envs.experiments.actions import ACTIONS, PUSHED

START = {"trajectory": "triangle", "stiffness": (200.0, 20.0, 0.0)}
# exact in single precision, in which actions are
GAIN = (0.5, 0.75, 0.5, 0.75, 0.25, 0.25, 0.375)
PUSH = Compensation(kind="push", gain=GAIN, load=(0.03125,))
STEPS = 12


def rollout(actions, **arguments):
    """Return observations (steps, …) and rewards of one arm."""
    env = GTEEnv(fixed_options=START, **arguments)
    env.reset(seed=3)
    found = [env.step(actions(env.action_space)) for _ in range(STEPS)]
    env.close()
    return np.array([f[0] for f in found]), np.array([f[1] for f in found])


def pushing(gain):
    """Return a function from a space to its action of no dither and a gain."""
    return lambda space: np.append(space.low[:14], gain).astype(np.float32)


def test_the_treatments_gains_are_the_treatment_to_the_bit():
    seen, reward = rollout(lambda space: space.low, compensation=PUSH)
    acted, same = rollout(pushing(GAIN), compensation=PUSH, action=PUSHED)
    assert np.array_equal(acted[:, :-7], seen)
    assert np.array_equal(same, reward)
    assert np.array_equal(acted[:, -7:], np.zeros((STEPS, 7)))


def test_no_gain_is_no_treatment_to_the_bit_and_any_other_moves_the_arm():
    seen, _ = rollout(lambda space: space.low)
    still, _ = rollout(pushing(np.zeros(7)), compensation=PUSH, action=PUSHED)
    assert np.array_equal(still[:, :-7], seen)
    assert np.array_equal(still[:, -7:], -np.ones((STEPS, 7)))
    pushed, _ = rollout(pushing(2 * np.array(GAIN)), compensation=PUSH, action=PUSHED)
    assert not np.array_equal(pushed[:, :7], seen[:, :7])
    assert np.array_equal(pushed[:, -7:], np.ones((STEPS, 7)))


def test_a_multiple_of_the_gains_is_that_multiple_of_the_treatment():
    """The load gain follows: half of all gains is the push of half the friction."""
    seen, _ = rollout(lambda space: space.low, compensation=PUSH.times(0.5))
    half, _ = rollout(pushing(0.5 * np.array(GAIN)), compensation=PUSH, action=PUSHED)
    assert np.array_equal(half[:, :-7], seen)


@pytest.mark.parametrize("sensing", ["ideal", "robot"])
def test_a_row_of_a_batch_is_the_arm_alone_for_any_number_of_threads(sensing):
    arguments = {"compensation": PUSH, "action": PUSHED, "sensing": sensing, "fixed_options": START}
    batches = [GTEVectorEnv(5, threads=k, **arguments) for k in (1, 2)]
    alone = GTEEnv(**arguments)
    rng = np.random.default_rng(7)
    space = alone.action_space
    found = [b.reset(seed=20)[0] for b in batches]
    one, _ = alone.reset(seed=23)
    for _ in range(STEPS):
        assert np.array_equal(found[0], found[1])
        assert np.array_equal(found[0][3], one)
        action = rng.uniform(space.low, space.high, (5, 21)).astype(np.float32)
        found = [b.step(action)[0] for b in batches]
        one = alone.step(action[3])[0]


def test_a_file_of_gains_is_the_middle_of_the_range(tmp_path):
    write_compensation(tmp_path / "compensation.csv", PUSH)
    name = "stiction_envs:PandaGTE-v0"
    env = gym.make(name, action=PUSHED, compensation=tmp_path / "compensation.csv")
    scaled = gym.wrappers.RescaleAction(env, -1.0, 1.0)
    assert env.action_space.high[14:].tolist() == [2 * g for g in GAIN]
    assert scaled.action(np.zeros(21, np.float32))[14:].tolist() == list(GAIN)
    assert env.unwrapped.observation_names[-7:] == tuple(f"push_{j}" for j in range(1, 8))


def test_without_gains_those_of_the_model_are_the_middle():
    env = GTEEnv(action=PUSHED)
    believed = env.core.experiment.compensation("push")
    assert env.core.compensation == believed
    assert env.action_space.high[14:] == pytest.approx(2 * np.array(believed.gain), rel=1e-6)


@pytest.mark.parametrize("name", AGENTS)
def test_agents_dither_and_leave_the_gains_alone(name):
    env = GTEVectorEnv(2, action=PUSHED, compensation=PUSH, fixed_options=START)
    dithering = GTEVectorEnv(2, compensation=PUSH, fixed_options=START)
    observation, _ = env.reset(seed=1)
    other, _ = dithering.reset(seed=1)
    action, _ = AGENTS[name](env).predict(observation)
    assert action.shape == (2, 21)
    assert action[:, 14:].tolist() == [list(GAIN)] * 2
    assert action in env.action_space
    if name != "random":  # whose draws are of the observation
        assert np.array_equal(action[:, :14], AGENTS[name](dithering).predict(other)[0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"action": "push"}, "unknown action 'push': expected one of dither, dither+push"),
        ({"action": PUSHED, "compensation": "partial"}, "compensation partial: expected push"),
        (
            {
                "action": PUSHED,
                "compensation": dataclasses.replace(PUSH, gain=(1, 1, 0, 1, 1, 1, 1)),
            },
            "compensation gain of joint 3 is 0: expected > 0 N·m",
        ),
    ],
)
def test_what_cannot_be_acted_on_is_refused(arguments, message):
    with pytest.raises(StictionError, match=re.escape(message)):
        GTEEnv(**arguments)


def test_a_gain_beyond_its_range_is_refused():
    env = GTEEnv(action=PUSHED, compensation=PUSH, fixed_options=START)
    env.reset(seed=1)
    with pytest.raises(StictionError, match=r"push gain of joint 5 is 1 N·m: expected 0 to 0.5"):
        env.step(pushing([0, 0, 0, 0, 1, 0, 0])(env.action_space))
    with pytest.raises(StictionError, match=r"action has shape \(1, 14\): expected \(1, 21\)"):
        env.step(env.action_space.low[:14])
    assert set(ACTIONS) == {"dither", PUSHED}
