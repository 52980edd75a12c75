"""What a policy is trained and evaluated on: an arm, an experiment, the environment's arguments."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stiction_envs.envs.gte import GTEVectorEnv
from stiction_envs.envs.gte_core import GTECore
from stiction_envs.envs.gym_env import ArmVectorEnv
from stiction_envs.envs.registration import KINDS
from stiction_envs.envs.sje import SJEVectorEnv
from stiction_envs.envs.sje_core import SJECore
from stiction_envs.errors import unknown
from stiction_envs.robots.chain import title
from stiction_envs.robots.registry import ARMS

EXPERIMENTS = ("sje", "gte")
"""Experiments that have environments."""
_NOT_OPTIONS = ("self", "num_envs", "robot", "nthread", "record")


@dataclass(frozen=True, kw_only=True)
class Task:
    """An environment that is not made yet."""

    robot: str
    """Name of an arm, or path to its MJCF or URDF."""
    experiment: str
    """One of `EXPERIMENTS`."""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    """Of the environment."""
    nthread: int = 0
    """Threads of the physics, 0 for all processors; no result depends on it."""

    def __post_init__(self) -> None:
        if self.experiment not in EXPERIMENTS:
            raise unknown("experiment", self.experiment, EXPERIMENTS)
        names = argument_names(self.experiment)
        for name in self.arguments:
            if name not in names:
                raise unknown(f"argument of the {self.experiment} environment", name, names)

    @property
    def kind(self) -> str:
        """End of the environment's identifier, its version in it: ``GTE-v0``."""
        return next(k for k in KINDS if k.lower().startswith(f"{self.experiment}-"))

    @property
    def name(self) -> str:
        """What people call it: ``PandaGTE-v0``, or the arm's file and ``GTE-v0``."""
        arm = ARMS.get(self.robot)
        title = arm.environment if arm is not None else None
        return f"{title}{self.kind}" if title else f"{self.arm_name} {self.kind}"

    @property
    def arm_name(self) -> str:
        """Name of the arm, or of its file."""
        if self.robot in ARMS:
            return self.robot
        return title(Path(self.robot).stem, self.arguments.get("chain"))

    def make(self, num_envs: int) -> ArmVectorEnv:
        """Return a native batch whose episodes start anew in the step in which they end.

        Raises:
            StictionError: an argument or a reset option of it that is no good.
        """
        kind = SJEVectorEnv if self.experiment == "sje" else GTEVectorEnv
        arguments = {**self.arguments, "nthread": self.nthread}
        return kind(num_envs, robot=self.robot, autoreset_mode="SameStep", **arguments)


def argument_names(experiment: str) -> list[str]:
    """Return the names of an environment's arguments, besides the arm and the threads."""
    core = SJECore if experiment == "sje" else GTECore
    return [n for n in inspect.signature(core.__init__).parameters if n not in _NOT_OPTIONS]
