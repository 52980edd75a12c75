"""Constants of training and evaluation; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import check_numbers, load_settings


@dataclass(frozen=True, kw_only=True)
class PPOSettings:
    """Proximal policy optimisation (Schulman et al. 2017), by Stable-Baselines3."""

    envs: int
    """Arms that are stepped together."""
    rollout: int
    """Steps of each arm between two updates."""
    batch_size: int
    """Transitions of a gradient step."""
    epochs: int
    """Passes over a rollout."""
    learning_rate: float
    """Of Adam [-]."""
    gamma: float
    """Discount per step [-]."""
    gae_lambda: float
    """Of the advantage estimate [-]."""
    clip_range: float
    """Of the probability ratio [-]."""
    entropy: float
    """Weight of the entropy [-]."""
    log_std: float
    """Logarithm of the first standard deviation of an action, in [-1, 1] of its range."""
    network: tuple[int, ...]
    """Units of each hidden layer (tanh), of actor and critic alike."""

    def __post_init__(self) -> None:
        shares = ("gamma", "gae_lambda", "clip_range")
        check_numbers(self, shares=shares, from_zero=("entropy",), signed=("log_std",))


@dataclass(frozen=True, kw_only=True)
class OffPolicySettings:
    """What soft actor-critic and TD3 have in common."""

    envs: int
    """Arms that are stepped together."""
    learning_starts: int
    """Steps with random actions at the beginning."""
    gradient_steps: int
    """Updates after each step of all arms."""
    batch_size: int
    """Transitions of a gradient step."""
    buffer_size: int
    """Most transitions that are kept."""
    learning_rate: float
    """Of Adam [-]."""
    gamma: float
    """Discount per step [-]."""
    tau: float
    """By how much target networks follow, per update [-]."""
    network: tuple[int, ...]
    """Units of each hidden layer (ReLU), of actor and critics alike."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("gamma", "tau"))


@dataclass(frozen=True, kw_only=True)
class SACSettings(OffPolicySettings):
    """Soft actor-critic (Haarnoja et al. 2018) with learned temperature, by Stable-Baselines3."""

    temperature: float
    """Price of entropy at first, in normalised reward; learned from there on."""


@dataclass(frozen=True, kw_only=True)
class TD3Settings(OffPolicySettings):
    """Twin delayed deterministic policy gradient (Fujimoto et al. 2018), by Stable-Baselines3."""

    noise: float
    """Standard deviation of what is added to an action to explore, in [-1, 1] of its range."""
    policy_delay: int
    """Updates of the critics per update of the actor."""
    target_noise: float
    """Standard deviation of the noise that smooths the critics' targets."""
    target_clip: float
    """Most of that noise."""


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """What happens while a policy is trained, whatever the algorithm."""

    evaluation_every: int
    """Steps between two evaluations."""
    evaluation_episodes: int
    """Episodes of each, the same ones every time."""
    checkpoint_every: int
    """Steps between two checkpoints: what an interruption may cost."""
    final_episodes: int
    """Episodes with other seeds on which the finished policy is compared."""
    clip_observation: float
    """Normalised observations are within this [standard deviations]."""
    clip_reward: float
    """So are normalised rewards."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class StartSettings:
    """A policy that begins with an amplitude table."""

    slope: float
    """How much it varies at first, over an untrained network [-]."""
    most: float
    """Most and least of its action where a tanh bounds it, in [-1, 1] of the range."""
    log_std: float
    """Logarithm of PPO's first standard deviation, in [-1, 1] of the action's range."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("most",), signed=("log_std",))


@dataclass(frozen=True, kw_only=True)
class EvaluationSettings:
    """Episodes on which policies are compared."""

    episodes: int
    """Default number of them."""
    test_paths: int
    """First number of the random paths that are evaluated on; training may draw smaller ones."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class FileSettings:
    """What a policy's file may be: a stranger's could be made to fill the memory."""

    most_bytes: int
    """Of all that is in it, unpacked."""
    most_entries: int
    """Files in it."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class DistilSettings:
    """The closest gated table and rule to what a policy does."""

    episodes: int
    """Default number that is looked at."""
    starts: int
    """Gates, and thresholds, from which a joint's fit is started: each with each."""
    gate_rad_s: tuple[float, float]
    """Slowest and fastest gate speed; a gate that ends on the fastest is none [rad/s]."""
    threshold: tuple[float, float]
    """Lowest and highest torque threshold over stiction; one on the lowest is none [-]."""
    least_share: float
    """A joint whose amplitude is below this share of the highest possible is not dithered [-]."""
    edge: float
    """A gate or threshold this near its bound is on it, in its logarithm [-]."""
    least_spread: float
    """Amplitudes whose standard deviation is below this share of the highest are constant [-]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class PolicySettings:
    """All of this room."""

    ppo: PPOSettings
    """Proximal policy optimisation."""
    sac: SACSettings
    """Soft actor-critic."""
    td3: TD3Settings
    """Twin delayed deterministic policy gradient."""
    run: RunSettings
    """Evaluations and checkpoints."""
    start: StartSettings
    """Trainings from a table on."""
    evaluation: EvaluationSettings
    """Comparisons."""
    file: FileSettings
    """A policy's file."""
    distil: DistilSettings
    """A table from a policy."""


@cache
def policy_settings() -> PolicySettings:
    """Return the defaults."""
    return load_settings(PolicySettings, Path(__file__).with_name("settings.toml"))
