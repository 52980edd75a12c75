"""An agent does the same without an environment as in one."""

from __future__ import annotations

import numpy as np
import pytest

from stiction_envs.envs.agents import GatedTable, TorqueRule
from stiction_envs.envs.evaluation import evaluate
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import measure
from stiction_envs.experiments.gte.protocol import Case
from tests.envs.helpers import sprint
from tests.tuning.policies.small import made_up
from tuning.policies.path_runner import PathRunner
from tuning.policies.task import Task

CASES = (
    Case(trajectory="triangle", stiffness=(400, 40, 0)),
    Case(trajectory="pentagon", stiffness=(200, 20, 0)),
)


@pytest.fixture(scope="module")
def experiment():
    return GeneratedTrajectoryExperiment("panda", motion=sprint())


@pytest.fixture(scope="module")
def env():
    arguments = {"control_interval_s": 0.1, "motion": sprint()}
    return Task(robot="panda", experiment="gte", arguments=arguments).make(2)


def policy_of(env):
    space = env.single_action_space
    return made_up(names=env.observation_names, low=space.low, high=space.high, interval=0.1)


@pytest.mark.parametrize("make", [policy_of, GatedTable, TorqueRule])
def test_inside_and_outside_are_the_same_bits(experiment, env, make):
    """Error left at the goals, vibration, durations: of every iteration, on two paths."""
    agent = make(env)
    runs = PathRunner(experiment, agent, interval=0.1).run(CASES, iterations=2)
    for case, run in zip(CASES, runs, strict=True):
        measures = measure(run, experiment.protocol)
        options = [
            {"trajectory": case.trajectory, "stiffness": case.stiffness, "iteration": k}
            for k in range(2)
        ]
        rows = evaluate(env, agent, [0, 1], options)
        for k, row in enumerate(rows):
            left = np.linalg.norm(measures.settling[k][:, :3], axis=-1).mean()
            assert row["position_left_m"] == pytest.approx(left, rel=1e-12)
            assert row["duration_s"] == measures.duration[k]
            assert row["vibration_moving_mm"] == 1e3 * measures.shaking[k]
    assert len({r["position_left_m"] for r in rows}) == 2


def test_it_looks_at_its_own_rate(experiment, env):
    calls = []

    class Slow(GatedTable):
        def predict(self, observation, *arguments, **named):
            calls.append(observation.shape)
            return super().predict(observation, *arguments, **named)

    runs = PathRunner(experiment, Slow(env), interval=0.5).run(CASES[:1], iterations=3)
    assert set(calls) == {(3, env.single_observation_space.shape[0])}
    # the last run ends within the last block
    assert len(calls) == int(np.ceil(len(runs[0].time) / 50))


@pytest.mark.parametrize(
    ("agent", "interval", "words"),
    [
        (object(), None, "expected the interval"),
        (object(), 0.05, "multiples of 0.02 s"),
        (made_up(robot="iiwa7"), None, "GTE environment of iiwa7: expected one for the GTE"),
        (made_up(), None, "policy for other observations"),
    ],
)
def test_agents_that_do_not_fit(experiment, agent, interval, words):
    with pytest.raises(StictionError, match=words):
        PathRunner(experiment, agent, interval=interval)
