"""``stiction train`` and ``stiction evaluate`` from the command line to their files."""

import json
import shlex

import pytest

from stiction_envs.envs.agents import AGENTS
from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.gte.random_paths import RANDOM
from stiction_envs.reporting.output_folder import NAME
from tests.cli.short_commands import EPISODES, TRAINING
from tests.command_line import csv_rows
from tests.tuning.policies.small import made_up
from tuning import names

pytest.importorskip("stable_baselines3")
from tuning.policies import algorithms
from tuning.policies import train as training

QUICK = shlex.split(EPISODES)


@pytest.fixture
def settings(inputs):
    path = inputs / "small.toml"
    path.write_text(TRAINING)
    return path


@pytest.fixture
def train(cli, settings):
    """Run a short training with more arguments."""

    def run(*more, algo="ppo", steps=64):
        argv = ["train", "panda", "sje", "--algo", algo, "--steps", steps]
        return cli(*argv, "--settings", settings, *QUICK, *more)

    return run


@pytest.mark.slow
def test_train_writes_what_the_contract_says(train, cli, work):
    ran = train("--out", "out", "--json")
    assert ran.code == 0
    result = json.loads(ran.out)
    files = {"policy.zip", "evaluation.csv", "curve.csv", "curve.png"}
    assert {p.name for p in (work / "out").iterdir()} - {"tensorboard"} == files | {NAME}
    assert [r["steps"] for r in csv_rows(work / "out" / "curve.csv")] == ["0", "32", "64"]
    assert result["steps"] == 64
    assert "100 % ppo: return" in ran.err
    found = csv_rows(work / "out" / "evaluation.csv")
    assert [r["policy"] for r in found] == ["none", "none", "trained", "trained"]
    assert found[0]["seed"] == found[2]["seed"]
    # the policy plays in the environment that it was trained for, on seeds of its own
    policies = ["--policy", "none", "out/policy.zip"]
    options = [*policies, *QUICK, "--json", "--episodes", 2, "--out", "evaluated"]
    ran = cli("evaluate", "panda", "sje", *options)
    assert ran.code == 0
    result = json.loads(ran.out)
    assert list(result["summary"]) == ["none", "out/policy.zip"]
    assert result["summary"]["out/policy.zip"]["power"] > 0
    assert len(csv_rows(work / "evaluated" / "evaluation.csv")) == 4
    assert (work / "evaluated" / NAME).exists()


@pytest.mark.slow
def test_ctrl_c_and_the_same_command_again(train, work, monkeypatch):
    save = training._Checkpoints._on_step

    def interrupted(self):
        if training.newest(work / "parts" / "checkpoint") is not None:
            raise KeyboardInterrupt
        return save(self)

    often = ["--checkpoint-every", 32]
    with monkeypatch.context() as patched:
        patched.setattr(training._Checkpoints, "_on_step", interrupted)
        ran = train("--out", "parts", *often)
    assert ran.code == 1
    assert ran.lines[-1] == (
        "error: interrupted: the last checkpoint is kept; run the same command again to go on "
        "from it"
    )
    assert train("--out", "parts", *often, "--seed", 1).code == 2, "another training"
    ran = train("--out", "parts", *often)
    assert ran.code == 0
    assert ran.out.startswith("ppo, 64 steps: evaluated return ")
    assert [r["steps"] for r in csv_rows(work / "parts" / "curve.csv")] == ["0", "32", "64"]


BAD_TRAINING = {
    "panda sje --algo a2c --steps 64": "unknown algorithm 'a2c': expected one of sac, ppo, td3",
    "panda sje --algo ppo --steps 31": "31 steps: expected at least 32: one rollout",
    "panda sje --algo ppo --steps 0": "whole numbers from 1",
    "panda push --algo ppo --steps 64": "'push'",
    "panda gte --algo ppo --steps 64 --compensation shove": "unknown compensation 'shove'",
    "panda gte --algo ppo --steps 64 --compensation no.csv": "no.csv",
}
BAD_OPTIONS = {
    "--compensation push": "--compensation: not with sje",
    "--checkpoint-every 0": "whole numbers from 1",
    "--env gravity=0": "unknown argument of the sje environment 'gravity'",
    "--env gravity": "--env gravity: expected NAME=VALUE",
    "--env friction=3": "arguments of the sje environment: ",
    "--env control_interval_s=x": "arguments of the sje environment: ",
    "--env fixed_options=3": "--env fixed_options=3: expected a JSON object",
    "--env control_interval_s=0.123": "control_interval_s 0.123",
    """--env 'fixed_options={"knot":6}'""": "unknown reset option 'knot'",
    """--env 'randomise={"mass":1}'""": "unknown spread to randomise 'mass'",
    "--trajectory triangle": "--trajectory: not with sje",
    "--settings {own.toml}": "no such setting: expected one of",
}
BAD_TRAINING |= {f"panda sje --algo ppo --steps 64 {k}": v for k, v in BAD_OPTIONS.items()}


@pytest.mark.parametrize(("line", "says"), BAD_TRAINING.items(), ids=BAD_TRAINING)
def test_bad_training_is_refused(refused, settings, inputs, line, says):
    (inputs / "own.toml").write_text("[ppo]\nspeed = 3\n")
    words = shlex.split(line)
    quick = QUICK if words[1] == "sje" else ()
    usual = [*words[:2], "--settings", settings, *quick]
    assert says in refused("train", *usual, *words[2:])


BAD_POLICIES = {
    "gte --policy best": "unknown policy 'best': expected one of none, gated, random",
    "gte --policy policy.zip": "policy.zip: no such file",
    "gte --policy none none": "expected each once",
    "gte --policy {iiwa.zip}": "GTE-v0 of iiwa7: expected one for GTE-v0 of panda",
    "sje --policy {gte.zip}": "expected one for SJE-v0 of panda",
    "gte --policy {gte.zip}": "policy for other observations",
    "gte --policy {table.csv}": "joint 7: 50 N·m",
}


@pytest.mark.parametrize(("line", "says"), BAD_POLICIES.items(), ids=BAD_POLICIES)
def test_policies_that_cannot_be_played(refused, inputs, line, says):
    made_up(robot="iiwa7").save(inputs / "iiwa.zip")
    made_up().save(inputs / "gte.zip")
    (inputs / "table.csv").write_text("joint,frequency_hz,amplitude_nm\n7,15,50\n")
    assert says in refused("evaluate", "panda", *line.split())


def test_a_table_of_means_is_shown_and_the_gated_table_is_an_input(cli, work):
    ran = cli("evaluate", "panda", "sje", "--policy", "none", "gated", *QUICK, "--episodes", 2)
    assert ran.code == 0
    lines = ran.out.splitlines()
    assert lines[0] == "PandaSJE-v0, 2 episodes"
    assert lines[1].split()[:3] == ["policy", "return", "±"]
    assert [line.split()[0] for line in lines[2:4]] == ["none", "gated"]
    assert lines[-1] == "written to runs/evaluate-panda"
    inputs_of = json.loads((work / "runs" / "evaluate-panda" / NAME).read_text())["inputs"]
    assert "panda_gated.csv" in str(inputs_of)


def test_names_are_those_of_the_packages():
    """The commands have them without loading environments or Stable-Baselines3."""
    assert tuple(algorithms.ALGORITHMS) == names.ALGORITHMS
    assert set(names.POLICIES) <= {*AGENTS, "gated"}
    assert (*TRAJECTORIES, RANDOM) == names.PATHS
