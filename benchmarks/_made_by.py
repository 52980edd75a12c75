"""Which code made a benchmark's rows: rows of other code are made anew, or told as such."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

from stiction_envs.precomputed.store import MADE_BY

ROOT = Path(__file__).parents[1]
KINDS = (".py", ".toml", ".xml", ".csv", ".json")
"""Files that decide what comes out."""
ALWAYS = ("mujoco", "numpy", "scipy")
"""Packages whose versions do."""
EPISODES = (
    *(f"stiction_envs/{place}" for place in MADE_BY),
    *("!stiction_envs/reporting", "!stiction_envs/experiments/*/plots.py"),
)
"""Rooms and files of the package that have a part in an episode: not those that only show it."""
LOGS = tuple(
    f"stiction_envs/{place}"
    for place in (
        *("compiled.py", "friction", "gap", "measured", "method_settings.py"),
        *("precomputed", "robots"),
    )
)
"""Likewise in what is said of joint logs."""
PACKAGES = ("numba", "pin")
"""Packages besides `ALWAYS` that have a part in episodes and in what is said of logs."""


def made_by(places: Sequence[str], packages: Sequence[str] = ()) -> str:
    """Return a hash of files and of the versions of packages.

    Args:
        places: files, folders or patterns, from the top level of the project; a pattern that is
            written after ``!`` takes files out again.
        packages: besides `ALWAYS`.

    Raises:
        ValueError: a place where nothing is.
    """
    out = hashlib.sha256()
    for name in (*ALWAYS, *packages):
        out.update(f"{name} {metadata.version(name)};".encode())
    for path in _files(places):
        out.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return out.hexdigest()


def _files(places: Sequence[str]) -> list[Path]:
    found: set[Path] = set()
    for place in places:
        those = set(_there(place.removeprefix("!")))
        if not those:
            raise ValueError(f"{place}: nothing is there")
        found = found - those if place.startswith("!") else found | those
    return sorted(found)


def _there(place: str) -> Iterator[Path]:
    for path in ROOT.glob(place):
        inside = path.rglob("*") if path.is_dir() else [path]
        yield from (p for p in inside if p.is_file() and p.suffix in KINDS)
