"""Where an arm is described: MJCF (or URDF) and the TOML beside it."""

from __future__ import annotations

from pathlib import Path

from stiction_envs.robots.registry import ARMS


def robot_files(robot: str | Path) -> dict[str, Path]:
    """Return the files of a robot by name or path, as far as they are there.

    Returns:
        ``robot``: MJCF or URDF; ``robot_table``: the TOML of the same stem.
    """
    known = ARMS.get(str(robot))
    path = Path(robot).expanduser() if known is None else known.model
    if not path.name:  # "." or "/"
        return {}
    found = {"robot": path, "robot_table": path.with_suffix(".toml")}
    return {k: v for k, v in found.items() if v.is_file()}
