"""Names of the environments. Light on purpose: nothing here imports MuJoCo."""

from __future__ import annotations

import gymnasium

_SJE = ("stiction_envs.envs.sje:SJEEnv", "stiction_envs.envs.sje:SJEVectorEnv")
_GTE = ("stiction_envs.envs.gte:GTEEnv", "stiction_envs.envs.gte:GTEVectorEnv")
ENVIRONMENTS: dict[str, tuple[tuple[str, str], str]] = {
    "PandaSJE-v0": (_SJE, "panda"),
    "IiwaSJE-v0": (_SJE, "iiwa7"),
    "PandaGTE-v0": (_GTE, "panda"),
    "IiwaGTE-v0": (_GTE, "iiwa7"),
}
"""Identifier: entry points of the single and the vector environment, default robot."""


def register_all() -> None:
    """Register every environment that Gymnasium does not know yet.

    No `max_episode_steps`: the environments truncate by themselves, alone and in a batch.
    """
    for name, ((single, vector), robot) in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name, entry_point=single, vector_entry_point=vector, kwargs={"robot": robot}
            )
