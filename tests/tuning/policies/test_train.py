"""A training that is interrupted goes on to the bit; its policy is Stable-Baselines3's in numpy."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.control.compensation import Compensation
from stiction_envs.errors import StictionError
from stiction_envs.measured import AmplitudeRow
from tests.tuning.policies.small import SPRINT, small_settings

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3.common.vec_env import VecNormalize

from tuning.policies import checkpoint
from tuning.policies import train as training
from tuning.policies.algorithms import export, make_env, make_model
from tuning.policies.evaluation import read_agent
from tuning.policies.policy import Policy
from tuning.policies.resumable_env import ResumableVecEnv
from tuning.policies.settings import PolicySettings
from tuning.policies.task import Task
from tuning.policies.train import train

ALGORITHMS = ("ppo", "sac", "td3")
STEPS = 160
SMALL = small_settings()


def interrupted(monkeypatch, after: int):
    """Interrupt a training after a number of checkpoints."""
    saved = []

    def save(*arguments, **named):
        checkpoint.save(*arguments, **named)
        saved.append(arguments)
        if len(saved) == after:
            raise KeyboardInterrupt

    monkeypatch.setattr(training, "save", save)


def last(folder: Path) -> tuple[dict, dict, dict]:
    """Return all that the only checkpoint in a folder holds."""
    (place,) = (folder / "checkpoint").iterdir()
    with np.load(place / "arrays.npz") as file:
        arrays = {name: file[name] for name in file.files}
    state = json.loads((place / "state.json").read_text())
    for episode in state["returns"]:
        del episode["t"]  # seconds on somebody's clock
    return torch.load(place / "weights.pt", weights_only=True), arrays, state


def equal(a, b) -> bool:
    """Whether nested tensors and arrays are the same bits."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[k], b[k]) for k in a)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(equal(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, torch.Tensor):
        return torch.equal(a, b)
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    return a == b


@pytest.mark.parametrize("algorithm", [pytest.param(a, marks=pytest.mark.slow) for a in ALGORITHMS])
def test_an_interrupted_training_goes_on_to_the_bit(tmp_path, monkeypatch, algorithm):
    """Curve, policy, networks, optimisers, generators, replay buffer: all of it, in the middle of
    episodes, whatever the process drew meanwhile."""
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir()
    parts.mkdir()
    straight = train(SPRINT, algorithm, steps=STEPS, out=whole, settings=SMALL)
    with monkeypatch.context() as patched:
        interrupted(patched, 2)
        with pytest.raises(KeyboardInterrupt):
            train(SPRINT, algorithm, steps=STEPS, out=parts, settings=SMALL)
    _, arrays, _ = last(parts)
    assert 0 < arrays["lengths"].max() < 14, "in the middle of episodes"
    np.random.default_rng()
    np.random.normal(size=7)  # noqa: NPY002
    torch.randn(7)
    again = train(SPRINT, algorithm, steps=STEPS, out=parts, settings=SMALL)
    assert straight.resumed_at is None
    assert again.resumed_at == 96
    for name in ("curve.csv", "policy.zip"):
        assert (parts / name).read_bytes() == (whole / name).read_bytes()
    assert equal(last(parts), last(whole))
    assert again.points[-1].steps == STEPS


def test_a_finished_training_is_not_begun_again(tmp_path, monkeypatch):
    first = train(SPRINT, "ppo", steps=32, out=tmp_path, settings=SMALL)
    monkeypatch.setattr(training._Process, "_learn", lambda _: pytest.fail("trained"))
    again = train(SPRINT, "ppo", steps=32, out=tmp_path, settings=SMALL)
    assert again.points == first.points or str(again.points) == str(first.points)
    assert again.steps_per_second is None


def test_the_curve_has_a_row_per_evaluation(tmp_path):
    said = []
    trained = train(
        SPRINT,
        "ppo",
        steps=96,
        out=tmp_path,
        settings=SMALL,
        progress=lambda stage, share: said.append((stage, share)),
    )
    with open(tmp_path / "curve.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(r["steps"]) for r in rows] == [0, 64, 96]
    assert [int(r["episodes"]) for r in rows] == [0, 4, 0]
    assert rows[0]["training_return"] == "nan"
    assert [float(r["evaluation_return"]) for r in rows] == [
        p.evaluation_return for p in trained.points
    ]
    assert trained.best.evaluation_return == max(p.evaluation_return for p in trained.points)
    assert trained.policy.card.training["steps"] == trained.best.steps
    assert said[-1] == (
        f"ppo: return {trained.points[-1].evaluation_return:.3f}, best "
        f"{trained.best.evaluation_return:.3f}",
        1.0,
    )


def pretend_tensorboard(monkeypatch, spec):
    """Pretend that it is installed, or not; torch still finds other modules."""
    find = training.importlib.util.find_spec
    monkeypatch.setattr(
        training.importlib.util, "find_spec", lambda n: spec if n == "tensorboard" else find(n)
    )


def test_tensorboard_has_a_folder_for_every_start(tmp_path, monkeypatch):
    folders = []
    pretend_tensorboard(monkeypatch, object())
    make = training.make_logger
    monkeypatch.setattr(training, "make_logger", lambda f: folders.append(f) or make(None))
    assert train(SPRINT, "ppo", steps=32, out=tmp_path, settings=SMALL).notes == ()
    assert folders == [tmp_path / "tensorboard" / "from-000000000"]


def test_without_tensorboard_one_line_says_so(tmp_path, monkeypatch):
    pretend_tensorboard(monkeypatch, None)
    for _ in range(2):  # the second finds it finished: its report says the same
        trained = train(SPRINT, "ppo", steps=32, out=tmp_path, settings=SMALL)
        said = ("tensorboard is not installed: the curve is in curve.csv alone",)
        assert trained.notes == said


def test_evaluations_are_of_the_same_episodes(tmp_path):
    """A policy that does not change (learning rate next to 0) has the same return every time."""
    still = small_settings(**{"ppo.learning_rate": 1e-30})
    points = train(SPRINT, "ppo", steps=64, out=tmp_path, settings=still).points
    # the normalisation of what is seen changes
    assert points[0].evaluation_return == pytest.approx(points[-1].evaluation_return, abs=0.005)
    assert points[0].evaluation_std == pytest.approx(points[-1].evaluation_std, abs=0.005)


def test_a_policy_that_pushes_starts_with_the_treatments_gains(tmp_path):
    """Untrained (learning rate next to 0) it is the treatment alone: a return of −1, but for its
    exploration; it plays where it was trained, not where there are no gains."""
    gain = (0.5, 0.75, 0.5, 0.75, 0.25, 0.25, 0.375)
    pushing = {"action": "dither+push", "compensation": Compensation(kind="push", gain=gain)}
    task = replace(SPRINT, arguments={**SPRINT.arguments, **pushing})
    assert training.first_action(task, []).tolist() == [-1.0] * 7 + [0.0] * 14
    still = small_settings(**{"ppo.learning_rate": 1e-30})
    trained = train(task, "ppo", steps=32, out=tmp_path, settings=still)
    policy = trained.policy
    assert policy.card.action == "dither+push"
    env = task.make(2)
    observation, _ = env.reset(seed=1)
    action, _ = policy.predict(observation)
    assert action[:, :7] == pytest.approx(0, abs=0.01)
    assert action[:, 14:] == pytest.approx(np.array([gain] * 2), rel=0.01)
    assert trained.points[0].evaluation_return == pytest.approx(-1, abs=0.1)
    read_agent(str(tmp_path / "policy.zip"), task, env)
    with pytest.raises(StictionError, match=r"policy for action dither\+push: expected one for di"):
        read_agent(str(tmp_path / "policy.zip"), SPRINT, SPRINT.make(1))
    other = {**pushing, "compensation": Compensation(kind="push", gain=(0.5,) * 7)}
    moved = replace(SPRINT, arguments={**SPRINT.arguments, **other})
    with pytest.raises(StictionError, match=r"checkpoint .*arguments"):
        train(moved, "ppo", steps=32, out=tmp_path, settings=still)


@pytest.mark.slow
def test_a_killed_process_goes_on(tmp_path):
    """kill -9 at any moment, with a half-written checkpoint in the folder."""
    root = Path(__file__).parents[3]
    code = (
        "import sys; from pathlib import Path\n"
        "from tests.tuning.policies.small import SPRINT, small_settings\n"
        "from tuning.policies.train import train\n"
        f"train(SPRINT, 'sac', steps={STEPS}, out=Path(sys.argv[1]), settings=small_settings())\n"
    )
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir()
    parts.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(root)}
    process = subprocess.Popen([sys.executable, "-c", code, str(parts)], env=environment, cwd=root)
    end = time.monotonic() + 120
    while checkpoint.newest(parts / "checkpoint") is None and time.monotonic() < end:
        time.sleep(0.05)
    assert process.poll() is None, "it was killed on its way"
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert checkpoint.newest(parts / "checkpoint") is not None
    half = parts / "checkpoint" / checkpoint.PART
    half.mkdir(exist_ok=True)
    (half / "arrays.npz").write_bytes(b"half")
    went_on = train(SPRINT, "sac", steps=STEPS, out=parts, settings=SMALL)
    assert 0 < went_on.resumed_at < STEPS
    train(SPRINT, "sac", steps=STEPS, out=whole, settings=SMALL)
    assert (parts / "curve.csv").read_bytes() == (whole / "curve.csv").read_bytes()
    assert equal(last(parts), last(whole))


# ---- the policy ----------------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_policy_is_stable_baselines_deterministic_action(tmp_path, algorithm):
    """To 1e-6 of the action's range, with networks of the default size, normalised."""
    settings = PolicySettings(**vars(small_settings()))
    own = getattr(small_settings(**{f"{algorithm}.network": (128, 128)}), algorithm)
    model = make_model(own, make_env(SPRINT, 4, settings.run, 0.99), seed=3)
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


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_training_begins_with_a_table(tmp_path, algorithm):
    """For every observation, to a hundredth of the range; joints not in the table rest."""
    table = [AmplitudeRow(2, 40.0, 1.0), AmplitudeRow(6, 25.0, 0.5)]
    still = small_settings(**{f"{algorithm}.learning_rate": 1e-30})
    policy = train(SPRINT, algorithm, steps=32, out=tmp_path, start=table, settings=still).policy
    size = len(policy.card.observation_names)
    seen = np.random.default_rng(0).normal(scale=3.0, size=(50, size))
    action, _ = policy.predict(seen)
    span = policy.high - policy.low
    expected = np.zeros(14)
    expected[[1, 5]], expected[[8, 12]] = (1.0, 0.5), (40.0, 25.0)
    there = [0, 1, 2, 3, 4, 5, 6, 8, 12]
    # a tanh does not come to its bound
    most = 0.01 if algorithm == "ppo" else 0.03
    assert np.abs((action - expected) / span)[:, there].max() < most
    assert np.ptp(action[:, 1]) > 0, "it does look"


def test_a_start_that_the_environment_cannot_do(tmp_path):
    start = [AmplitudeRow(2, 40.0, 50.0)]
    with pytest.raises(StictionError, match=r"joint 2: 50 N·m: expected 0 to"):
        train(SPRINT, "ppo", steps=32, out=tmp_path, start=start, settings=SMALL)
    assert list(tmp_path.iterdir()) == []


def test_another_network_is_refused():
    own = SMALL.ppo
    model = make_model(own, make_env(SPRINT, 4, SMALL.run, 0.99), seed=3)
    model.policy.mlp_extractor.policy_net[1] = torch.nn.ELU()
    with pytest.raises(StictionError, match="expected one of Tanh, ReLU"):
        export(model, SPRINT)


# ---- episodes in the middle ----------------------------------------------------------------------


RAMPS = Task(
    robot="panda",
    experiment="sje",
    arguments={"control_interval_s": 0.2, "fixed_options": {"load": "no_load"}},
)
"""Ramps of any joint take 28 steps or more."""
PATHS = replace(
    SPRINT, arguments={**SPRINT.arguments, "fixed_options": {"stiffness": (400, 40, 0)}}
)
"""Triangles of 14 steps, pentagons of 21."""


@pytest.mark.parametrize(
    ("task", "seed"),
    [
        pytest.param(RAMPS, 1, id="sje"),
        pytest.param(PATHS, 1, id="gte", marks=pytest.mark.slow),
    ],
)
def test_arms_on_their_way_are_brought_back(task, seed):
    """Observations, rewards, ends and the next episodes, of arms at different times."""
    env = ResumableVecEnv(task.make(3))
    env.seed(seed)
    env.reset()
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 0, size=(90, 3, 14)).astype(np.float32)
    for a in actions[:30]:
        env.step(a)
    generators, since = env.snapshot()
    assert min(map(len, since)) < 30, "an episode has ended"
    assert len(set(map(len, since))) > 1, "the arms are at different times"
    other = ResumableVecEnv(task.make(3))
    seen = other.restore(generators, since)
    ended = 0
    for a in actions[30:]:
        mine, theirs = env.step(a), other.step(a)
        for x, y in zip(mine[:3], theirs[:3], strict=True):
            assert np.array_equal(x, y)
        ended += int(mine[2].sum())
    assert ended >= 3
    assert seen.shape == mine[0].shape
    assert equal(list(env.snapshot()), list(other.snapshot()))


# ---- bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"algorithm": "a2c"}, "unknown algorithm 'a2c': expected one of sac, ppo, td3"),
        ({"steps": 31}, "31 steps: expected at least 32: one rollout of 4 arms, 8 steps each"),
        ({"algorithm": "sac", "steps": 19}, "19 steps: expected at least 20: 16 at random"),
        (
            {"task": Task(robot="panda", experiment="gte", arguments={"random_paths": 1001})},
            "random_paths 1001: expected at most 1000: policies are evaluated on the others",
        ),
    ],
)
def test_bad_input_writes_nothing(tmp_path, change, words):
    arguments = {"task": SPRINT, "algorithm": "ppo", "steps": 64, **change}
    with pytest.raises(StictionError) as error:
        train(**arguments, out=tmp_path, settings=SMALL)
    assert words in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_unknown_arguments_and_experiments():
    with pytest.raises(StictionError, match="unknown argument of the gte environment 'gravity'"):
        Task(robot="panda", experiment="gte", arguments={"gravity": 0})
    with pytest.raises(StictionError, match="expected one of sje, gte"):
        Task(robot="panda", experiment="push")


@pytest.fixture(scope="module")
def begun(tmp_path_factory) -> Path:
    """A folder with a checkpoint of a training."""
    folder = tmp_path_factory.mktemp("begun")
    train(SPRINT, "ppo", steps=32, out=folder, settings=SMALL)
    return folder


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 1}, "of another training: seed is 0: expected 1"),
        ({"start": [AmplitudeRow(2, 40.0, 1.0)]}, "of another training: start is []: expected ["),
        ({"steps": 64}, "steps is 32: expected 64"),
        ({"algorithm": "sac"}, "algorithm is 'ppo': expected 'sac'"),
        ({"settings": small_settings(**{"ppo.gamma": 0.9})}, "settings is '"),
        ({"task": Task(robot="iiwa7", experiment="gte")}, "robot is 'panda': expected 'iiwa7'"),
        ({"task": Task(robot="panda", experiment="sje")}, "environment is 'GTE-v0'"),
        ({"task": Task(robot="panda", experiment="gte")}, "arguments is {"),
    ],
)
def test_a_checkpoint_of_another_training(begun, change, words):
    arguments = {"task": SPRINT, "algorithm": "ppo", "steps": 32, "settings": SMALL, **change}
    before = {p: p.stat().st_mtime_ns for p in begun.rglob("*")}
    with pytest.raises(StictionError) as error:
        train(out=begun, **arguments)
    assert words in str(error.value)
    assert {p: p.stat().st_mtime_ns for p in begun.rglob("*")} == before


def test_without_the_extra_one_line_says_what_to_install():
    code = (
        "import sys; sys.modules['stable_baselines3'] = None\n"
        "from stiction_envs.errors import StictionError\n"
        "try:\n    import tuning.policies.train\n"
        "except StictionError as error:\n    print(error)\n"
    )
    root = Path(__file__).parents[3]
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root
    )
    assert ran.stdout == (
        "stiction train needs stable-baselines3: pip install 'stiction-envs[rl]'\n"
    )
