"""Constants of training and evaluation; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import (
    Count,
    NotNegative,
    Positive,
    Share,
    load_settings,
)


@dataclass(frozen=True, kw_only=True)
class AlgorithmSettings:
    """Settings that all algorithms share."""

    envs: Count
    """Arms that are stepped together."""
    batch_size: Count
    """Transitions of a gradient step."""
    learning_rate: Positive
    """Learning rate of Adam [-]."""
    gamma: Share
    """Discount per step [-]."""
    network: tuple[Count, ...]
    """Units of each hidden layer (PPO: tanh, others: ReLU), the same for actor and critics."""


@dataclass(frozen=True, kw_only=True)
class PPOSettings(AlgorithmSettings):
    """Proximal policy optimisation (Schulman et al. 2017), by Stable-Baselines3."""

    rollout: Count
    """Steps of each arm between two updates."""
    epochs: Count
    """Passes over a rollout."""
    gae_lambda: Share
    """λ of the generalised advantage estimate [-]."""
    clip_range: Share
    """Clip range of the probability ratio [-]."""
    entropy: NotNegative
    """Weight of the entropy [-]."""
    log_std: float
    """Logarithm of an action's initial standard deviation, in [-1, 1] of its range."""


@dataclass(frozen=True, kw_only=True)
class OffPolicySettings(AlgorithmSettings):
    """Settings that soft actor-critic and TD3 share."""

    learning_starts: Count
    """Steps with random actions at the beginning."""
    gradient_steps: Count
    """Updates after each step of all arms."""
    buffer_size: Count
    """Largest number of transitions in the replay buffer."""
    tau: Share
    """Rate at which target networks follow, per update [-]."""


@dataclass(frozen=True, kw_only=True)
class SACSettings(OffPolicySettings):
    """Soft actor-critic (Haarnoja et al. 2018) with learned temperature, by Stable-Baselines3."""

    temperature: float
    """Initial weight of the entropy, in normalised reward; it is learned afterwards."""


@dataclass(frozen=True, kw_only=True)
class TD3Settings(OffPolicySettings):
    """Twin delayed deterministic policy gradient (Fujimoto et al. 2018), by Stable-Baselines3."""

    noise: float
    """Standard deviation of the exploration noise on an action, in [-1, 1] of its range."""
    policy_delay: int
    """Updates of the critics per update of the actor."""
    target_noise: float
    """Standard deviation of the noise that smooths the critics' targets."""
    target_clip: float
    """Bound of that noise."""


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """Settings of a training that hold for every algorithm."""

    evaluation_every: Count
    """Steps between two evaluations."""
    evaluation_episodes: Count
    """Episodes of each evaluation, the same ones every time."""
    final_episodes: Count
    """Episodes with other seeds on which the finished policy is compared."""
    clip_observation: Positive
    """Bound of normalised observations [standard deviations]."""
    clip_reward: Positive
    """Bound of normalised rewards [standard deviations]."""


@dataclass(frozen=True, kw_only=True)
class StartSettings:
    """A policy that starts from an amplitude table."""

    slope: Positive
    """Initial variation of the network's output, over that of an untrained network [-]."""
    most: Share
    """Bound of its action where a tanh limits it, in [-1, 1] of the range."""
    log_std: float
    """Logarithm of PPO's initial standard deviation, in [-1, 1] of the action's range."""


@dataclass(frozen=True, kw_only=True)
class EvaluationSettings:
    """Episodes on which policies are compared."""

    episodes: Count
    """Default number of episodes."""
    test_paths: Count
    """Number of the first random path for evaluation; training may draw smaller numbers."""


@dataclass(frozen=True, kw_only=True)
class FileSettings:
    """Limits of a policy file: a file from a stranger could otherwise fill the memory."""

    most_bytes: Count
    """Largest size of its content, unpacked."""
    most_entries: Count
    """Largest number of files in it."""


@dataclass(frozen=True, kw_only=True)
class PolicySettings:
    """All settings of this package."""

    ppo: PPOSettings
    """Proximal policy optimisation."""
    sac: SACSettings
    """Soft actor-critic."""
    td3: TD3Settings
    """Twin delayed deterministic policy gradient."""
    run: RunSettings
    """Evaluations, limits."""
    start: StartSettings
    """Trainings that start from a table."""
    evaluation: EvaluationSettings
    """Comparisons."""
    file: FileSettings
    """Limits of a policy file."""


@cache
def policy_settings() -> PolicySettings:
    """Return the defaults."""
    return load_settings(PolicySettings, Path(__file__).with_name("settings.toml"))
