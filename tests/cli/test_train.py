"""``stiction train`` and ``stiction evaluate`` from the command line to their files."""

import csv
import json
import sys

import pytest

from stiction_envs.experiments.gte.protocol import TRAJECTORIES
from stiction_envs.experiments.gte.random_paths import RANDOM
from stiction_envs.reporting.output_folder import NAME
from tests.tuning.policies.small import made_up
from tuning.commands import evaluate
from tuning.commands import train as command

pytest.importorskip("stable_baselines3")
from tuning.policies import algorithms, checkpoint, evaluation, task
from tuning.policies import train as training
from tuning.policies.settings import policy_settings

SETTINGS = """
[ppo]
envs = 4
rollout = 8
batch_size = 16
network = [16]
[sac]
envs = 4
learning_starts = 16
[run]
evaluation_every = 32
evaluation_episodes = 2
checkpoint_every = 32
final_episodes = 2
"""
QUICK = ["--env", "control_interval_s=0.2", 'fixed_options={"joint":6,"load":"no_load"}']


@pytest.fixture
def settings(inputs):
    path = inputs / "small.toml"
    path.write_text(SETTINGS)
    return path


@pytest.fixture
def train(cli, settings):
    """Run a short training; more arguments come behind, and before the usual ones."""

    def run(*more, experiment="sje", algo="ppo", steps=64):
        argv = ["train", "panda", experiment, "--algo", algo, "--steps", steps]
        return cli(*argv, "--settings", settings, *QUICK, *more)

    return run


def rows(path) -> list[dict[str, str]]:
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def test_train_writes_what_the_contract_says(train, cli, work):
    ran = train("--out", "out", "--json", "--distil")
    assert ran.code == 0
    result = json.loads(ran.out)
    files = {"policy.zip", "evaluation.csv", "curve.csv", "curve.png", "rule.csv"}
    files |= {"report.md", "report.html"}
    assert files | {NAME} <= {p.name for p in (work / "out").iterdir()}
    assert [r["steps"] for r in rows(work / "out" / "curve.csv")] == ["0", "32", "64"]
    assert result["steps"] == 64
    assert result["steps_per_second"] > 0
    assert "100 % ppo: return" in ran.err
    found = rows(work / "out" / "evaluation.csv")
    assert [r["policy"] for r in found] == ["none", "none", "trained", "trained"]
    assert found[0]["seed"] == found[2]["seed"]
    assert set(result["distilled"]["lost"]) == {"table", "rule"}
    # the policy plays in the environment that it was trained for, on seeds of its own
    ran = cli(
        "evaluate",
        "panda",
        "sje",
        "--policy",
        "none",
        "out/policy.zip",
        *QUICK,
        "--json",
        "--episodes",
        2,
        "--out",
        "evaluated",
    )
    assert ran.code == 0
    result = json.loads(ran.out)
    assert list(result["summary"]) == ["none", "out/policy.zip"]
    assert result["summary"]["out/policy.zip"]["power"] > 0
    assert len(rows(work / "evaluated" / "evaluation.csv")) == 4
    assert (work / "evaluated" / NAME).exists()


@pytest.mark.slow
def test_what_is_shown(train):
    ran = train("--distil", steps=32)
    lines = ran.out.splitlines()
    assert lines[0].startswith("ppo, 32 steps, ")
    assert lines[1] == "PandaSJE-v0, 2 episodes"
    assert "the closest gated table (final.csv) loses" in lines[-3]
    assert lines[-2].startswith("R² of its amplitudes, table: ")
    assert lines[-1].count(",") == 7


@pytest.mark.slow
def test_ctrl_c_and_the_same_command_again(train, work, monkeypatch):
    assert train("--out", "whole").code == 0

    def save(*arguments, **named):
        checkpoint.save(*arguments, **named)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(training, "save", save)
        ran = train("--out", "parts")
    assert ran.code == 1
    assert ran.lines[-1] == (
        "error: interrupted: the last checkpoint is kept; run the same command again to go on"
    )
    ran = train("--out", "parts", "--json")
    assert json.loads(ran.out)["resumed_at"] == 32
    for name in ("curve.csv", "policy.zip", "evaluation.csv", "curve.png", "report.html"):
        assert (work / "parts" / name).read_bytes() == (work / "whole" / name).read_bytes()
    before = {p: p.read_bytes() for p in (work / "parts").rglob("*") if p.is_file()}
    # of another training: seed, algorithm, steps, arm
    for other in (["--seed", 1], ["--tilt", 0.1, 0]):
        ran = train("--out", "parts", *other)
        assert ran.code == 2
        assert "holds a run of stiction train: choose another folder" in ran.lines[-1]
    assert train("--out", "parts", algo="sac").code == 2
    assert {p: p.read_bytes() for p in (work / "parts").rglob("*") if p.is_file()} == before
    ran = train("--out", "parts", "--seed", 1, "--force", "--json")
    assert ran.code == 0
    assert json.loads(ran.out)["resumed_at"] is None


BAD = {
    "algorithm": ({"algo": "a2c"}, [], "unknown algorithm 'a2c': expected one of sac, ppo, td3"),
    "few": ({"steps": 31}, [], "31 steps: expected at least 32: one rollout"),
    "few_sac": ({"steps": 19, "algo": "sac"}, [], "19 steps: expected at least 20"),
    "no_steps": ({"steps": 0}, [], "whole numbers from 1"),
    "experiment": ({"experiment": "push"}, [], "'push'"),
    "argument": ({}, ["--env", "gravity=0"], "unknown argument of the sje environment 'gravity'"),
    "no_value": ({}, ["--env", "gravity"], "--env gravity: expected NAME=VALUE"),
    "value": ({}, ["--env", "control_interval_s=0.123"], "control_interval_s 0.123"),
    "option": ({}, ["--env", 'fixed_options={"knot":6}'], "unknown reset option 'knot'"),
    "spread": ({}, ["--env", 'randomise={"mass":1}'], "unknown spread to randomise 'mass'"),
    "trajectory": ({}, ["--trajectory", "triangle"], "--trajectory: not with sje"),
    "setting": ({}, ["--settings", "{settings}"], "no such setting: expected one of"),
    "friction": ({}, ["--friction-factor", "0"], "expected finite numbers above 0"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_writes_nothing(train, work, inputs, name):
    named, more, words = BAD[name]
    own = inputs / "own.toml"
    own.write_text("[ppo]\nspeed = 3\n")
    ran = train(*[str(own) if x == "{settings}" else x for x in more], **named)
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert words in ran.err
    assert list(work.iterdir()) == []


def test_without_the_extra_one_line_says_what_to_install(train, work, monkeypatch):
    for name in [n for n in sys.modules if n.startswith(("stable_baselines3", "tuning.policies"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    ran = train()
    assert ran.code == 2
    assert ran.lines == [
        "error: stiction train needs stable-baselines3: pip install 'stiction-envs[rl]'"
    ]
    assert list(work.iterdir()) == []


BAD_POLICIES = {
    "name": ("gte", ["best"], "unknown policy 'best': expected one of none, gated, random, rule"),
    "missing": ("gte", ["policy.zip"], "policy.zip: no such file"),
    "twice": ("gte", ["none", "none"], "expected each once"),
    "robot": ("gte", ["{iiwa}"], "GTE environment of iiwa7: expected one for the GTE environment"),
    "experiment": ("sje", ["{gte}"], "expected one for the SJE environment of panda"),
    "observations": ("gte", ["{gte}"], "policy for other observations"),
    "table": ("gte", ["{table}"], "joint 7: 50 N·m"),
}


@pytest.mark.parametrize("name", BAD_POLICIES)
def test_policies_that_cannot_be_played(cli, work, inputs, name):
    experiment, policies, words = BAD_POLICIES[name]
    made_up(robot="iiwa7").save(inputs / "iiwa.zip")
    made_up().save(inputs / "gte.zip")
    (inputs / "table.csv").write_text("joint,frequency_hz,amplitude_nm\n7,15,50\n")
    files = {"{iiwa}": "iiwa.zip", "{gte}": "gte.zip", "{table}": "table.csv"}
    named = [str(inputs / files[p]) if p in files else p for p in policies]
    ran = cli("evaluate", "panda", experiment, "--policy", *named)
    assert ran.code == 2
    assert len(ran.lines) == 1
    assert words in ran.err
    assert list(work.iterdir()) == []


def test_another_friction_is_told_from_the_nominal_one(cli):
    returns = []
    for factor in (1, 1.2):
        ran = cli(
            "evaluate",
            "panda",
            "sje",
            "--policy",
            "none",
            *QUICK,
            "--episodes",
            2,
            "--friction-factor",
            factor,
            "--out",
            f"out{factor}",
            "--json",
        )
        assert ran.code == 0
        returns.append(json.loads(ran.out)["summary"]["none"]["return"])
    assert abs(returns[0]) < 0.05
    # up to a fifth more torque, in units of what is believed: the joint's offset stays
    assert -0.2 < returns[1] - returns[0] < -0.1


def test_a_table_of_means_is_shown(cli):
    ran = cli("evaluate", "panda", "sje", "--policy", "none", "rule", *QUICK, "--episodes", 2)
    assert ran.code == 0
    lines = ran.out.splitlines()
    assert lines[0] == "PandaSJE-v0, 2 episodes"
    assert lines[1].split()[:3] == ["policy", "return", "±"]
    assert [line.split()[0] for line in lines[2:4]] == ["none", "rule"]
    assert lines[-1] == "written to runs/evaluate-panda"


def test_names_are_those_of_the_packages():
    defaults = policy_settings().evaluation
    assert command.ALGORITHMS == algorithms.ALGORITHMS
    assert evaluate.EXPERIMENTS == task.EXPERIMENTS
    assert evaluate.NAMED == evaluation.NAMED
    assert (*TRAJECTORIES, RANDOM) == evaluate.TRAJECTORIES
    assert defaults.episodes == evaluate.EPISODES


def test_the_gated_table_is_among_the_inputs():
    """Whoever changes it gets another provenance; an arm without one has no file."""
    assert evaluate.policy_files("panda", ["none", "gated"])["gated"].name == "panda_gated.csv"
    assert evaluate.policy_files("iiwa7", ["none", "gated"]) == {}
