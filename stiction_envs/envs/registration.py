"""Names of the environments. Light on purpose: nothing here imports MuJoCo."""

from __future__ import annotations

import gymnasium

from stiction_envs.robots.registry import ArmFiles, on_arm

_SJE = ("stiction_envs.envs.sje:SJEEnv", "stiction_envs.envs.sje:SJEVectorEnv")
_GTE = ("stiction_envs.envs.gte:GTEEnv", "stiction_envs.envs.gte:GTEVectorEnv")
KINDS = {"SJE-v0": _SJE, "GTE-v0": _GTE}
"""End of an identifier: entry points of the single and the vector environment."""


def register_all() -> None:
    """Register the environments of every arm whose TOML names one, known now or later.

    An arm with ``environment = "Panda"`` has ``PandaSJE-v0`` and ``PandaGTE-v0``.
    """
    on_arm(register_arm)


def register_arm(arm: ArmFiles) -> None:
    """Register the environments of an arm that Gymnasium does not know yet.

    No `max_episode_steps`: the environments truncate by themselves, alone and in a batch.
    """
    if arm.environment is None:
        return
    for kind, (single, vector) in KINDS.items():
        if (name := f"{arm.environment}{kind}") not in gymnasium.registry:
            gymnasium.register(
                name, entry_point=single, vector_entry_point=vector, kwargs={"robot": arm.name}
            )
