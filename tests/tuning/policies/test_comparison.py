"""Policies on the same episodes."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.measured.tables import read_amplitudes
from tests.command_line import ROOT, csv_rows
from tests.tuning.policies.small import SPRINT, made_up
from tuning.policies.comparison import evaluate_all, read_agent


@pytest.fixture(scope="module")
def env():
    return SPRINT.make(3)


@pytest.fixture
def policy(env, tmp_path) -> Path:
    """A file of a policy with weights drawn from a seed, for the environment of these tests."""
    space = env.single_action_space
    names, bounds = env.observation_names, {"low": space.low, "high": space.high}
    made_up(names=names, interval=0.2, **bounds).save(tmp_path / "policy.zip")
    return tmp_path / "policy.zip"


def test_every_policy_meets_the_same_episodes(policy, tmp_path):
    """Rows do not depend on the other policies, nor on the number of episodes."""
    table = tmp_path / "table.csv"
    table.write_text("joint,frequency_hz,amplitude_nm\n6,30,0.5\n")
    names = ["none", str(policy), str(table)]
    evaluated = evaluate_all(SPRINT, names, episodes=3, seed=5)
    assert evaluated.policies == names
    for name in names:
        assert evaluated.values(name, "seed").tolist() == [5, 6, 7]
        assert evaluated.values(name, "episode").tolist() == [0, 1, 2]
    alone = evaluate_all(SPRINT, [str(policy)], episodes=2, seed=6)
    assert [{**r, "episode": r["episode"] + 1} for r in alone.rows] == [
        r for r in evaluated.rows if r["policy"] == str(policy) and r["seed"] > 5
    ]
    none, shaken = evaluated.values("none", "return"), evaluated.values(str(table), "return")
    assert np.all(shaken != none)
    assert np.all(evaluated.values(str(table), "power") > 0)
    summary = evaluated.summary()
    assert summary["none"]["return"] == pytest.approx(none.mean())
    assert summary["none"]["return_error"] == pytest.approx(none.std(ddof=1) / math.sqrt(3))
    assert summary["none"]["power"] == 0
    evaluated.save(tmp_path)
    rows = csv_rows(tmp_path / "evaluation.csv")
    assert [float(r["return"]) for r in rows[:3]] == none.tolist()


def test_random_paths_are_those_of_no_training():
    options = {"trajectory": "random", "stiffness": (200, 20, 0)}
    task = replace(SPRINT, arguments={**SPRINT.arguments, "fixed_options": options})
    evaluated = evaluate_all(task, ["none"], episodes=2, seed=7)
    assert evaluated.values("none", "path").tolist() == [1000, 1001]
    assert evaluated.values("none", "seed").tolist() == [7, 8]
    assert SPRINT.make(1).core.random_paths <= 1000


def test_the_shipped_table_is_the_best_of_the_search(env):
    """`benchmarks/learning/search.md` has it; cut to what the environment can do."""
    shipped = ROOT / "stiction_envs" / "dither" / "tables" / "panda_gated.csv"
    source = ROOT / "benchmarks" / "learning" / "search" / "panda_gte_gated_1600.csv"
    assert shipped.read_bytes() == source.read_bytes()
    agent = read_agent("gated", SPRINT, env)
    rows = read_amplitudes(shipped, n_joints=7)
    top = env.single_action_space.high[:7]
    assert agent.amplitude == pytest.approx(np.minimum([r.amplitude_nm for r in rows], top))
    assert agent.gate.tolist() == [r.gate_rad_s for r in rows]


def test_gates_of_a_table_are_kept_to(env, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(
        "joint,frequency_hz,amplitude_nm,waveform,offset_nm,gate_rad_s\n"
        "6,30,0.5,sine,0,0.1\n7,30,0.5,sine,0,0\n"
    )
    agent = read_agent(str(path), SPRINT, env)
    names = list(env.observation_names)
    seen = np.zeros(len(names), dtype=np.float32)
    seen[[names.index("velocity_6"), names.index("velocity_7")]] = 0.1
    action, _ = agent.predict(seen)
    assert action[5] == pytest.approx(0.5 * math.exp(-1), rel=1e-6)
    assert action[6] == pytest.approx(0.5)
