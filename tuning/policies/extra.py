"""Stable-Baselines3 and torch, which only training needs: here or one line that says so."""

from __future__ import annotations

from stiction_envs.errors import missing_extra

try:
    import torch
    from stable_baselines3 import PPO, SAC, TD3
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
    from stable_baselines3.common.running_mean_std import RunningMeanStd
    from stable_baselines3.common.vec_env import (
        VecMonitor,
        VecNormalize,
        sync_envs_normalization,
    )
except ImportError:
    raise missing_extra("stiction train", "stable-baselines3", "rl") from None

__all__ = [
    "PPO",
    "SAC",
    "TD3",
    "BaseAlgorithm",
    "BaseCallback",
    "Logger",
    "NormalActionNoise",
    "OffPolicyAlgorithm",
    "RunningMeanStd",
    "TensorBoardOutputFormat",
    "VecMonitor",
    "VecNormalize",
    "evaluate_policy",
    "sync_envs_normalization",
    "torch",
]
