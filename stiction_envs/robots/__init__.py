"""Robot arms as data: one rigid MJCF and one TOML with limits and sources for each."""

from stiction_envs.robots.arm import BUILTIN, Arm, load_arm
from stiction_envs.robots.tables import Limits

__all__ = ["BUILTIN", "Arm", "Limits", "load_arm"]
