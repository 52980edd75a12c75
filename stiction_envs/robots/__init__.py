"""Robot arms as data: one rigid MJCF and one TOML with limits and sources for each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stiction_envs.robots.registry import ARMS, BUILTIN, arm_title, register_arm_folder

if TYPE_CHECKING:
    from stiction_envs.robots.arm import Arm, load_arm
    from stiction_envs.robots.arm_toml import Limits

__all__ = ["ARMS", "BUILTIN", "Arm", "Limits", "arm_title", "load_arm", "register_arm_folder"]


def __getattr__(name: str) -> object:
    """Load what needs MuJoCo when it is first asked for: arms are listed without it."""
    if name in ("Arm", "load_arm"):
        from stiction_envs.robots import arm

        return getattr(arm, name)
    if name == "Limits":
        from stiction_envs.robots.arm_toml import Limits

        return Limits
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
