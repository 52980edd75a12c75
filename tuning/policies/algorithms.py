"""Stable-Baselines3's algorithms with our defaults, and the policies of their models.

Needs the extra `rl`: ``pip install 'stiction-envs[rl]'``.
"""

import inspect
from collections.abc import Mapping
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stiction_envs.errors import StictionError, missing_extra, one_line, unknown
from stiction_envs.reporting.provenance import versions
from tuning.policies.policy import Card, Policy
from tuning.policies.settings import AlgorithmSettings, PolicySettings, RunSettings
from tuning.policies.task import Task

try:
    import torch
    from stable_baselines3 import PPO, SAC, TD3
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.callbacks import CheckpointCallback, EvalCallback
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    from stiction_envs.envs.sb3 import SB3VecEnv
except ImportError:
    raise missing_extra("stiction train", "stable-baselines3", "rl") from None

__all__ = ["CheckpointCallback", "EvalCallback"]
SB3 = Any  # Arguments and objects of Stable-Baselines3, which have more than its declared types
ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"sac": SAC, "ppo": PPO, "td3": TD3}
"""Stable-Baselines3's classes by the names of the algorithms."""


def settings_of(algorithm: str, settings: PolicySettings) -> AlgorithmSettings:
    """Return the settings of one of `ALGORITHMS`.

    Raises:
        StictionError: another algorithm, or an argument that Stable-Baselines3 does not know.
    """
    if algorithm not in ALGORITHMS:
        raise unknown("algorithm", algorithm, ALGORITHMS)
    found = {"sac": settings.sac, "ppo": settings.ppo, "td3": settings.td3}[algorithm]
    known = inspect.signature(ALGORITHMS[algorithm]).parameters
    for name in found.arguments:
        if name not in known:
            raise unknown(f"argument of {algorithm}", name, known)
    for name in ("n_steps", "learning_starts"):
        if type(value := found.arguments.get(name, 1)) is not int:
            raise StictionError(f"{algorithm}: {name} is {value!r}: expected a whole number")
    return found


def least_steps(settings: AlgorithmSettings) -> tuple[int, str]:
    """Return the smallest number of steps from which anything is learned, and the reason."""
    envs = settings.envs
    if "n_steps" in settings.arguments:
        rollout = settings.arguments["n_steps"]
        return envs * rollout, f"one rollout of {envs} arms, {rollout} steps each"
    random = settings.arguments.get("learning_starts", 100)  # Stable-Baselines3's default
    return random + envs, f"{random} at random, then one of each of {envs} arms"


def make_env(
    task: Task, num_envs: int, run: RunSettings, algorithm: AlgorithmSettings
) -> VecNormalize:
    """Return N arms as Stable-Baselines3 trains on them: monitored, normalised."""
    return VecNormalize(
        VecMonitor(SB3VecEnv(task.make(num_envs))),
        clip_obs=run.clip_observation,
        clip_reward=run.clip_reward,
        gamma=algorithm.arguments.get("gamma", 0.99),
    )


def make_model(
    algorithm: str, settings: AlgorithmSettings, env: VecNormalize, seed: int
) -> BaseAlgorithm:
    """Return an untrained model; everything random in it follows from the seed.

    From here on torch uses one thread: its sums depend on the number of threads, and small networks
    are not faster with more.

    Raises:
        StictionError: an argument that Stable-Baselines3 does not take.
    """
    torch.set_num_threads(1)
    arguments: dict[str, SB3] = dict(settings.arguments)
    if "action_noise" in arguments:
        spread = np.full(env.action_space.shape or (), arguments["action_noise"])
        arguments["action_noise"] = NormalActionNoise(np.zeros_like(spread), spread)
    kind: SB3 = ALGORITHMS[algorithm]
    try:
        model: BaseAlgorithm = kind("MlpPolicy", env, seed=seed, device="cpu", **arguments)
    except Exception as error:  # what Stable-Baselines3 and torch raise of a wrong argument
        raise StictionError(f"arguments of {algorithm}: {one_line(error)}") from error
    return model


def load_checkpoint(algorithm: str, place: Path, env: VecNormalize) -> BaseAlgorithm:
    """Return the model of a checkpoint's folder, which can run code, at the start of new episodes.

    The checkpoint's normalisation takes the place of that of ``env`` (`make_env`).

    Raises:
        StictionError: a checkpoint that cannot be read.
    """
    torch.set_num_threads(1)
    steps = int(place.name)
    try:
        file = place / f"rl_model_vecnormalize_{steps}_steps.pkl"
        normal = VecNormalize.load(str(file), env.venv)
        file = place / f"rl_model_{steps}_steps.zip"
        model = ALGORITHMS[algorithm].load(file, normal, device="cpu")
        if isinstance(model, OffPolicyAlgorithm):
            model.load_replay_buffer(place / f"rl_model_replay_buffer_{steps}_steps.pkl")
    except Exception as error:  # unpickling raises any
        why = str(error).partition("\n")[0]
        raise StictionError(f"checkpoint {place}: cannot be read: {why}") from error
    return model


def log_to(model: BaseAlgorithm, folder: Path) -> None:
    """Let a model log to TensorBoard if it is installed, and not at all otherwise."""
    there = find_spec("tensorboard") is not None
    model.set_logger(Logger(str(folder), [TensorBoardOutputFormat(str(folder))] if there else []))


# ---- the actor as numbers ------------------------------------------------------------------------


def export(
    model: BaseAlgorithm, task: Task, training: Mapping[str, object] | None = None
) -> Policy:
    """Return a model of Stable-Baselines3, its normalisation included, as a numeric policy.

    Args:
        model: PPO, SAC or TD3 with an ``MlpPolicy`` that was trained on actions in [-1, 1]
            (`SB3VecEnv`), with or without `VecNormalize`.
        task: task of the training.
        training: description of the training.
    """
    layers, output = _layers(model)
    linear = [x for x in layers if isinstance(x, torch.nn.Linear)]
    between = {type(x) for x in layers if not isinstance(x, torch.nn.Linear)}
    names: dict[type, SB3] = {torch.nn.Tanh: "tanh", torch.nn.ReLU: "relu"}
    if len(between) > 1 or not between <= set(names):
        raise StictionError(f"layers {between}: expected one of Tanh, ReLU between linear ones")
    batch: SB3 = model.get_env().unwrapped.env.unwrapped  # type: ignore[union-attr]
    size = batch.single_observation_space.shape
    normal: SB3 = model.get_vec_normalize_env()
    used = normal is not None and normal.norm_obs
    packages = {x: metadata.version(x) for x in ("stable-baselines3", "torch", "numpy")}
    return Policy(
        card=Card(
            robot=task.arm_name,
            environment=task.kind,
            observation_names=tuple(batch.observation_names),
            interval=float(batch.core.interval),
            activation=names[between.pop()] if between else "relu",
            output=output,
            clip=float(normal.clip_obs) if used else float(np.finfo(np.float32).max),
            epsilon=float(normal.epsilon) if used else 1.0,
            training={**(training or {}), "versions": {**versions(), **packages}},
        ),
        low=batch.single_action_space.low.astype(float),
        high=batch.single_action_space.high.astype(float),
        mean=np.array(normal.obs_rms.mean) if used else np.zeros(size),
        variance=np.array(normal.obs_rms.var) if used else np.zeros(size),
        weights=tuple(x.weight.detach().cpu().numpy().astype(float) for x in linear),
        biases=tuple(x.bias.detach().cpu().numpy().astype(float) for x in linear),
    )


def _layers(model: BaseAlgorithm) -> tuple[list[SB3], Literal["tanh", "clip"]]:
    """Return the actor's layers in order, the last linear, and how the action is bounded."""
    policy: SB3 = model.policy
    if isinstance(model, PPO):
        return [*policy.mlp_extractor.policy_net, policy.action_net], "clip"
    if isinstance(model, SAC):
        return [*policy.actor.latent_pi, policy.actor.mu], "tanh"
    if isinstance(model, TD3):
        return list(policy.actor.mu)[:-1], "tanh"
    raise StictionError(f"{type(model).__name__}: expected one of PPO, SAC, TD3")
