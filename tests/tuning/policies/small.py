"""Short trainings and made-up policies for the tests of this room."""

from typing import Any

import numpy as np

from stiction_envs.method_settings import override
from tests.envs.helpers import TRIANGLE, sprint
from tuning.policies.policy import Card, Policy
from tuning.policies.settings import PolicySettings, policy_settings
from tuning.policies.task import Task

SPRINT = Task(
    robot="panda",
    experiment="gte",
    arguments={
        "control_interval_s": 0.2,
        "motion": sprint(),
        "fixed_options": TRIANGLE,
        # so that what an episode draws besides its case is needed, too
        "randomise": {"friction": 0.1},
    },
)
"""Episodes of 14 steps."""


def small_settings(**changes: Any) -> PolicySettings:
    """Return networks of 16 units, four arms, an evaluation of two episodes every 64 steps."""
    few: dict[str, Any] = {"run.evaluation_every": 64, "run.evaluation_episodes": 2}
    few |= {"run.final_episodes": 2, "ppo.arguments.n_steps": 8}
    for name in ("ppo", "sac", "td3"):
        few |= {f"{name}.envs": 4, f"{name}.arguments.batch_size": 16}
        few[f"{name}.arguments.policy_kwargs.net_arch"] = [16]
    for name in ("sac", "td3"):
        few |= {f"{name}.arguments.learning_starts": 16, f"{name}.arguments.gradient_steps": 1}
        few[f"{name}.arguments.buffer_size"] = 80  # full before the second checkpoint
    return override(policy_settings(), {**few, **changes})


def made_up(
    *,
    robot: str = "panda",
    names: tuple[str, ...] = ("a", "b", "c"),
    low: Any = (0.0, 5.0),
    high: Any = (2.0, 100.0),
    interval: float = 0.1,
    hidden: int = 4,
    output: str = "tanh",
) -> Policy:
    """Return a policy with one hidden layer and random weights."""
    rng = np.random.default_rng(0)
    n = len(names)
    return Policy(
        card=Card(
            robot=robot,
            environment="GTE-v0",
            observation_names=names,
            interval=interval,
            activation="tanh",
            output=output,
            clip=10.0,
            epsilon=1e-8,
            training={"algorithm": "made up"},
        ),
        low=np.array(low, float),
        high=np.array(high, float),
        mean=rng.normal(size=n),
        variance=rng.uniform(0.5, 2.0, size=n),
        weights=(rng.normal(size=(hidden, n)), rng.normal(size=(len(low), hidden))),
        biases=(rng.normal(size=hidden), rng.normal(size=len(low))),
    )
