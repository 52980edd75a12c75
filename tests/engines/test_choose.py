"""Engines by name: the default is MuJoCo's batch; what is unknown or missing is one line."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from mujoco.batch import Batch

from stiction_envs.engines import choose
from stiction_envs.engines.choose import DEFAULT_ENGINE, ENGINES, check_engine
from stiction_envs.errors import StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.model import build
from stiction_envs.plant import Plant
from stiction_envs.robots import load_arm
from tuning.commands import evaluate
from tuning.policies.task import Task

UNKNOWN = "unknown engine 'wrap': expected one of mujoco, warp"
MISSING = "engine warp needs mujoco-warp: pip install 'stiction-envs[warp]'"


@pytest.fixture
def without_warp(monkeypatch):
    monkeypatch.setattr(choose, "find_spec", lambda name: None if name == "mujoco_warp" else name)


def test_the_default_is_mujocos_own_batch():
    assert DEFAULT_ENGINE == "mujoco"
    plant = Plant(build(load_arm("panda")), 2)
    assert isinstance(plant.batch, Batch)
    named = Plant(plant.sticking, 2, engine="mujoco")
    torque = np.full((2, 60, 7), 0.8)
    assert plant.run(torque).tobytes() == named.run(torque).tobytes()


def test_commands_know_the_engines():
    assert tuple(ENGINES) == evaluate.ENGINES


MAKERS = {
    "experiment": lambda name: SingleJointExperiment("panda", engine=name),
    "environment": lambda name: gym.make("stiction_envs:PandaSJE-v0", engine=name),
    "batch": lambda name: gym.make_vec("stiction_envs:IiwaGTE-v0", num_envs=2, engine=name),
    "task": lambda name: Task(robot="panda", experiment="sje", arguments={"engine": name}),
    "plant": lambda name: Plant(build(load_arm("panda")), 1, engine=name),
}


@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
def test_an_unknown_engine_is_one_line(maker):
    with pytest.raises(StictionError) as error:
        maker("wrap")
    assert str(error.value) == UNKNOWN


@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
def test_a_missing_package_is_one_line(maker, without_warp):
    with pytest.raises(StictionError) as error:
        maker("warp")
    assert str(error.value) == MISSING


def test_mujoco_is_always_there(without_warp):
    assert check_engine("mujoco") == "mujoco"


TRAIN = ("train", "panda", "sje", "--algo", "ppo", "--steps", "64")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--engine", "wrap"), "choose from 'mujoco', 'warp'"),
        (("--env", "engine=wrap"), UNKNOWN),
        (("--engine", "warp"), MISSING),
    ],
)
def test_commands_refuse_an_engine_in_one_line(options, says, refused, without_warp):
    assert says in refused(*TRAIN, *options)
