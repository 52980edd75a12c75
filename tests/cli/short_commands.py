"""Inputs and settings that make commands short."""

from pathlib import Path

import pytest

from stiction_envs.identification import settings
from stiction_envs.method_settings import override
from stiction_envs.robots import load_arm
from tests.gap.small_logs import dry, hidden, write_csv
from tuning.settings import tuning_settings

BASE_TWO = "robot,joint,load,direction,tau_base_Nm\n" + "".join(
    f"two,{j},{load},{d},{d}0.8\n" for j in (1, 2) for load in ("load", "no_load") for d in "+-"
)
"""Base torques of the arm of two joints."""
FRICTION = "".join(
    f"[{name}]\nvalue = {value}\nassumed = true\n"
    for name, value in {
        **{"stiction": 0.8, "coulomb_ratio": 0.8, "stribeck_velocity": 0.05, "viscous": 0.4},
        **{"bristle_stiffness": 600.0, "rotor_inertia": 0.2},
    }.items()
)
"""A user's friction TOML."""
TRAINING = """
[ppo]
envs = 4
arguments.n_steps = 8
arguments.batch_size = 16
arguments.policy_kwargs.net_arch = [16]
[sac]
envs = 4
arguments.learning_starts = 16
[run]
evaluation_every = 32
evaluation_episodes = 2
final_episodes = 2
"""
"""Settings of a short training."""
EPISODES = """--env control_interval_s=0.2 'fixed_options={"joint":6,"load":"no_load"}'"""
"""Arguments of short episodes of the SJE."""
FEW = {
    **{"robot.frequencies": 2, "robot.amplitudes": 2, "robot.iterations": 1},
    **{"search.draws": 1, "search.verify_draws": 2, "search.verify_iterations": 1},
}


@pytest.fixture
def log(two: Path, inputs: Path) -> Path:
    """A log of the small arm with dry friction."""
    path = inputs / "log.csv"
    write_csv(path, hidden(load_arm(two), dry))
    return path


@pytest.fixture
def short_motion(monkeypatch) -> None:
    few = {"iterations": 6, "randoms": 3, "starts": 1}
    motion = override(settings.excitation_settings(), few)
    monkeypatch.setattr(settings, "excitation_settings", lambda: motion)


@pytest.fixture
def few_settings(monkeypatch) -> None:
    """Leave so few settings to ask for, and frictions to try, that simulating them is quick."""
    asked = override(tuning_settings(), FEW)
    for module in ("robot.session", "search.search"):
        monkeypatch.setattr(f"tuning.{module}.tuning_settings", lambda: asked)
