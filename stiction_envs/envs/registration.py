"""The experiments that have environments, a line each. Light: nothing here imports MuJoCo.

A further experiment calls `register_experiment`; its folder holds what `experiments.rig` names.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

import gymnasium

from stiction_envs.errors import StictionError
from stiction_envs.robots.registry import ArmFiles, on_arm

if TYPE_CHECKING:
    from stiction_envs.envs.gym_env import ArmVectorEnv


@dataclass(frozen=True)
class Registered:
    """An experiment by its name, and where its environments are."""

    name: str
    """As commands call it, such as ``sje``."""
    single: str
    """``module:Class`` of its `gym_env.ArmEnv`."""
    vector: str
    """``module:Class`` of its `gym_env.ArmVectorEnv`."""
    returns: str = "return"
    """Label of an episode's return on an axis of a plot."""
    undithered_return: float | None = None
    """Mean return without dither, where the rewards define it."""

    @property
    def suffix(self) -> str:
        """End of an environment's identifier, its version in it: ``SJE-v0``."""
        return f"{self.name.upper()}-v0"

    def vector_class(self) -> type[ArmVectorEnv]:
        """Return the vector environment's class; its ``episodes`` is the experiment's."""
        module, _, name = self.vector.partition(":")
        found: type[ArmVectorEnv] = getattr(import_module(module), name)
        return found


EXPERIMENTS: dict[str, Registered] = {}


def register_experiment(new: Registered) -> None:
    """Register an experiment for every arm that names an environment, now or later.

    An arm with ``environment = "Panda"`` in its TOML has ``PandaSJE-v0`` and ``PandaGTE-v0``. No
    `max_episode_steps`: the environments truncate by themselves, alone and in a batch.
    """
    if new.name in EXPERIMENTS:
        raise StictionError(f"experiment {new.name!r}: expected one not in {sorted(EXPERIMENTS)}")
    EXPERIMENTS[new.name] = new

    def register_arm(arm: ArmFiles) -> None:
        name = f"{arm.environment}{new.suffix}"
        if arm.environment is not None and name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=new.single,
                vector_entry_point=new.vector,
                kwargs={"robot": arm.name},
            )

    on_arm(register_arm)


_OWN = (
    Registered(
        name="sje",
        single="stiction_envs.envs.sje:SJEEnv",
        vector="stiction_envs.envs.sje:SJEVectorEnv",
        returns="return [1 − |τ_SJE| / |τ_base|, less penalties]",
        undithered_return=0.0,
    ),
    Registered(
        name="gte",
        single="stiction_envs.envs.gte:GTEEnv",
        vector="stiction_envs.envs.gte:GTEVectorEnv",
        returns="return [−error / undithered error, less penalties]",
        undithered_return=-1.0,
    ),
)


def register_all() -> None:
    """Register the environments of the package's experiments, once."""
    for new in _OWN:
        if new.name not in EXPERIMENTS:
            register_experiment(new)
