"""Training: the same bits for a seed, and on from the last checkpoint after an interruption."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.command_line import csv_rows
from tests.refusal import refusal
from tests.tuning.policies.small import SPRINT, small_settings

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3.common.vec_env import VecNormalize

from tuning.policies.algorithms import export, load_checkpoint, make_env, make_model
from tuning.policies.policy import Policy
from tuning.policies.task import Task
from tuning.policies.train import Trained, Training, newest

ALGORITHMS = ("ppo", "sac", "td3")
SMALL = small_settings()


def training(algorithm: str = "ppo", steps: int = 160, **more: Any) -> Training:
    """Return a short training with a checkpoint every 48 steps."""
    given = {"task": SPRINT, "checkpoint_every": 48, "settings": SMALL, **more}
    return Training(algorithm=algorithm, steps=steps, **given)


def train(out: Path, *arguments: Any, **more: Any) -> Trained:
    out.mkdir(exist_ok=True)
    return training(*arguments, **more).run(out)


def interrupt(out: Path, plan: Training, after: int) -> None:
    """Interrupt a training after a number of checkpoints, while a further one is written."""
    seen = set()

    def progress(stage: str, share: float) -> None:
        seen.add(newest(out / "checkpoint"))
        if len(seen - {None}) == after:
            (out / "checkpoint" / "next").mkdir()
            (out / "checkpoint" / "next" / "policy.zip").write_bytes(b"half")
            raise KeyboardInterrupt

    out.mkdir(exist_ok=True)
    with pytest.raises(KeyboardInterrupt):
        plan.run(out, progress)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_same_seed_gives_the_same_files(tmp_path, algorithm):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        train(tmp_path / name, algorithm, 32, seed=seed)
        np.random.normal(size=7)  # noqa: NPY002
        torch.randn(7)
    for file in ("curve.csv", "policy.zip"):
        one, same, other = ((tmp_path / name / file).read_bytes() for name in "abc")
        assert one == same != other


@pytest.mark.parametrize("algorithm", ["ppo", pytest.param("sac", marks=pytest.mark.slow)])
def test_an_interrupted_training_goes_on_from_its_last_checkpoint(tmp_path, algorithm):
    """Normalisation, replay buffer and the evaluations until then are those of the checkpoint."""
    straight = train(tmp_path / "whole", algorithm)
    parts = tmp_path / "parts"
    interrupt(parts, training(algorithm), 2)
    place = newest(parts / "checkpoint")
    assert place is not None
    own = getattr(SMALL, algorithm)
    model: Any = load_checkpoint(algorithm, place, make_env(SPRINT, 4, SMALL.run, own))
    assert model.num_timesteps == 96
    normal = model.get_vec_normalize_env()
    assert isinstance(normal, VecNormalize)
    assert round(normal.obs_rms.count) == 4 + 96
    if algorithm == "sac":
        assert model.replay_buffer.full, "its 80 transitions"
        assert model.replay_buffer.rewards.any()
    again = train(parts, algorithm)
    assert straight.resumed_at is None
    assert again.resumed_at == 96
    assert [p.steps for p in again.points] == [0, 64, 160]
    assert again.points[:2] == straight.points[:2]
    assert not (parts / "checkpoint").exists()


def test_a_finished_training_has_its_curve_and_is_not_begun_again(tmp_path, monkeypatch):
    said = []
    trained = training(steps=96).run(tmp_path, lambda stage, share: said.append((stage, share)))
    rows = csv_rows(tmp_path / "curve.csv")
    assert [int(r["steps"]) for r in rows] == [0, 64, 96]
    returns = [p.evaluation_return for p in trained.points]
    assert [float(r["evaluation_return"]) for r in rows] == returns
    assert trained.best.evaluation_return == max(returns)
    assert trained.policy.card.training["steps"] == trained.best.steps
    assert said[-1] == (f"ppo: return {returns[-1]:.3f}, best {max(returns):.3f}", 1.0)
    monkeypatch.setattr(Training, "_learn", lambda *_: pytest.fail("trained"))
    again = train(tmp_path, steps=96)
    assert again.points == trained.points
    assert again.policy.card == trained.policy.card


# ---- the policy ----------------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_policy_is_stable_baselines_deterministic_action(tmp_path, algorithm):
    """To 1e-6 of the action's range, with networks of the default size, normalised."""
    network = {f"{algorithm}.arguments.policy_kwargs.net_arch": [128, 128]}
    own = getattr(small_settings(**network), algorithm)
    model = make_model(algorithm, own, make_env(SPRINT, 4, SMALL.run, own), seed=3)
    normal = model.get_vec_normalize_env()
    assert isinstance(normal, VecNormalize)
    rng = np.random.default_rng(0)
    size = len(normal.obs_rms.mean)
    normal.obs_rms.mean, normal.obs_rms.var = rng.normal(size=size), rng.uniform(0.1, 3.0, size)
    for parameter in model.policy.parameters():
        parameter.data += 0.05 * torch.randn_like(parameter)
    export(model, SPRINT).save(tmp_path / "policy.zip")
    policy = Policy.load(tmp_path / "policy.zip")
    seen = rng.normal(scale=3.0, size=(200, size)).astype(np.float32)
    theirs, _ = model.predict(normal.normalize_obs(seen), deterministic=True)
    mine, _ = policy.predict(seen)
    low, high = policy.low, policy.high
    assert np.abs(2 * (mine - low) / (high - low) - 1 - theirs).max() < 1e-6
    assert np.std(theirs, axis=0).min() > 0.01, "it does look"
    assert policy.card.observation_names[-1] == "frequency_7"
    assert policy.card.interval == 0.2


def test_another_network_is_refused():
    model = make_model("ppo", SMALL.ppo, make_env(SPRINT, 4, SMALL.run, SMALL.ppo), seed=3)
    model.policy.mlp_extractor.policy_net[1] = torch.nn.ELU()
    refusal(lambda: export(model, SPRINT), "expected one of Tanh, ReLU")


# ---- bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"algorithm": "sac", "steps": 19}, "19 steps: expected at least 20: 16 at random"),
        (
            {"settings": small_settings(**{"ppo.arguments.speed": 3})},
            "unknown argument of ppo 'speed': expected one of policy",
        ),
        (
            {"settings": small_settings(**{"ppo.arguments.batch_size": "many"})},
            "arguments of ppo: ",
        ),
        (
            {"task": Task(robot="panda", experiment="gte", arguments={"random_paths": 1001})},
            "random_paths 1001: expected at most 1000: policies are evaluated on the others",
        ),
    ],
)
def test_bad_input(change, words):
    refusal(lambda: training(**change).check(), words)


def test_a_damaged_checkpoint_is_one_line(tmp_path):
    interrupt(tmp_path, training(), 1)
    place = newest(tmp_path / "checkpoint")
    assert place is not None
    (place / "rl_model_48_steps.zip").write_bytes(b"damaged")
    refusal(lambda: train(tmp_path), r"^checkpoint .*000000048: cannot be read: ")
