"""A third experiment is one folder (``still``) and one registry line: all else finds it."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from stiction_envs.envs import registration
from stiction_envs.envs.agents import RandomDither
from stiction_envs.envs.evaluation import evaluate
from stiction_envs.errors import StictionError
from tests.envs.helpers import same
from tests.refusal import refusal
from tuning.policies.task import Task

MODULE = "tests.envs.still.experiment"
LINE = registration.Registered("still", f"{MODULE}:StillEnv", f"{MODULE}:StillVectorEnv")


@pytest.fixture
def registered():
    known = set(gym.registry)
    registration.register_experiment(LINE)
    yield
    del registration.EXPERIMENTS["still"]
    for name in set(gym.registry) - known:
        del gym.registry[name]


def test_every_arm_has_its_environment(registered):
    env = gym.make("PandaSTILL-v0", control_interval_s=0.02)
    check_env(env.unwrapped, skip_render_check=True)
    assert gym.spec("IiwaSTILL-v0").kwargs == {"robot": "iiwa7"}
    refusal(lambda: registration.register_experiment(LINE), "expected one not in")


def test_a_batch_is_the_single_environment(registered):
    one = gym.make("PandaSTILL-v0", control_interval_s=0.02)
    batch = gym.make_vec("PandaSTILL-v0", num_envs=3, control_interval_s=0.02)
    one.reset(seed=2), batch.reset(seed=0)
    action = 0.5 * (one.action_space.low + one.action_space.high)
    while True:
        alone, many = one.step(action), batch.step(np.tile(action, (3, 1)))
        assert same(alone[0], many[0][2])
        assert alone[1] == many[1][2] < 0
        assert alone[4]["moved"] == many[4]["moved"][2] > 0
        if alone[2]:
            break
    with pytest.raises(StictionError, match="no pictures"):
        gym.make("PandaSTILL-v0", render_mode="rgb_array").unwrapped.render()


def test_agents_are_evaluated_and_policies_may_be_trained_in_it(registered):
    task = Task(robot="panda", experiment="still", arguments={"control_interval_s": 0.05})
    assert task.name == "PandaSTILL-v0"
    batch = task.make(2)
    rows = evaluate(batch, RandomDither(batch), [1, 2, 3])
    assert [row["seed"] for row in rows] == [1, 2, 3]
    assert all(row["moved_rad"] > 0 and row["steps"] == 2 for row in rows)
