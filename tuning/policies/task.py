"""Task of a policy: an arm, an experiment, the environment's arguments."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from stiction_envs.envs.gym_env import ArmVectorEnv
from stiction_envs.envs.registration import EXPERIMENTS
from stiction_envs.errors import StictionError, one_line, unknown
from stiction_envs.robots.chain import chain_title
from stiction_envs.robots.registry import ARMS

_NOT_OPTIONS = ("robot", "threads")


@dataclass(frozen=True, kw_only=True)
class Task:
    """Description of an environment that has not been created."""

    robot: str  # Name of an arm, or path to its MJCF or URDF
    experiment: str  # One of `envs.registration.EXPERIMENTS`
    arguments: Mapping[str, Any] = field(default_factory=dict)
    threads: int = 0  # Threads of the physics, 0 for all processors; results do not depend on it

    def __post_init__(self) -> None:
        if self.experiment not in EXPERIMENTS:
            raise unknown("experiment", self.experiment, EXPERIMENTS)
        arguments = EXPERIMENTS[self.experiment].vector_class().episodes.arguments
        names = [f.name for f in fields(arguments) if f.name not in _NOT_OPTIONS]
        for name in self.arguments:
            if name not in names:
                raise unknown(f"argument of the {self.experiment} environment", name, names)

    @property
    def kind(self) -> str:
        """End of the environment's identifier with its version: ``GTE-v0``."""
        return EXPERIMENTS[self.experiment].suffix

    @property
    def name(self) -> str:
        """Name to show: ``PandaGTE-v0``, or the arm's file and ``GTE-v0``."""
        title = ARMS[self.robot].environment if self.robot in ARMS else None
        return f"{title}{self.kind}" if title else f"{self.arm_name} {self.kind}"

    @property
    def arm_name(self) -> str:
        """Name of the arm, or of its file."""
        if self.robot in ARMS:
            return self.robot
        return chain_title(Path(self.robot).stem, self.arguments.get("chain"))

    def make(self, num_envs: int) -> ArmVectorEnv:
        """Return a native batch whose episodes restart in the step in which they end.

        Raises:
            StictionError: an invalid argument or reset option.
        """
        arguments = {**self.arguments, "threads": self.threads}
        kind = EXPERIMENTS[self.experiment].vector_class()
        try:
            return kind(num_envs, robot=self.robot, autoreset_mode="SameStep", **arguments)
        except StictionError:
            raise
        except (TypeError, AttributeError, ValueError) as error:  # a value of another kind
            what = f"arguments of the {self.experiment} environment"
            raise StictionError(f"{what}: {one_line(error)}") from error
