"""Find the model of an arm in a folder of MuJoCo Menagerie, or by its name in robot_descriptions.

A folder's ``scene.xml`` puts a floor and light around the arm that it includes; the arm's file is
what is wanted. `robot_descriptions` names models and clones their repositories into its cache; only
what is in the cache is used, and nothing is downloaded.
Sources: google-deepmind/mujoco_menagerie; robot_descriptions, _cache.py.
"""

from __future__ import annotations

import importlib
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stiction_envs.errors import StictionError, missing_extra

Descriptions = Any  # of robot_descriptions, an extra that has no types
SCENE = "scene.xml"
ENDS = (".xml", ".mjcf", ".urdf")
MOST_BYTES = 2**24  # most bytes of a scene; assumed
_DESCRIPTION = re.compile(r"\w+_description")


def find_model(robot: str | Path) -> str | Path:
    """Return the file of an arm that a folder or a description names; else ``robot``.

    Raises:
        StictionError: a folder without one arm, or a description that is not in the cache.
    """
    path = Path(robot).expanduser()
    if path.name and path.is_dir():
        return in_folder(path)
    if isinstance(robot, str) and _DESCRIPTION.fullmatch(robot):
        return described(robot)
    return robot


def in_folder(folder: Path) -> Path:
    """Return the arm's file in a folder: the one that its scene includes, or the only one."""
    wanted = f"expected {SCENE} that includes one model, or a single {', '.join(ENDS)}"
    scene = folder / SCENE
    found = sorted(x for x in folder.iterdir() if x.suffix.lower() in ENDS and x.is_file())
    if scene in found:
        try:
            if scene.stat().st_size > MOST_BYTES:
                raise StictionError(f"{scene}: over {MOST_BYTES >> 20} MiB: {wanted}")
            root = ET.parse(scene).getroot()
        except (ET.ParseError, OSError, ValueError):
            raise StictionError(f"{scene}: no XML: {wanted}") from None
        files = [folder / x.get("file", "") for x in root.iter("include")]
        if not files:
            return scene
        found = [x for x in files if x.is_file()]
    if len(found) != 1:
        names = ", ".join(x.name for x in found[:6]) or "none"
        more = f" and {len(found) - 6} more" * (len(found) > 6)
        raise StictionError(f"{folder}: its models are {names}{more}: {wanted}")
    return found[0]


def described(name: str) -> Path:
    """Return the file of a model of `robot_descriptions` that is in its cache."""
    try:
        cache: Descriptions = importlib.import_module("robot_descriptions._cache")
        repositories = importlib.import_module("robot_descriptions._repositories").REPOSITORIES
        clone = cache.clone_to_cache
    except ImportError:
        raise missing_extra(f"robot {name!r}", "robot_descriptions", "descriptions") from None
    except AttributeError:
        raise StictionError(
            f"robot {name!r}: this version of robot_descriptions is not known: expected another, "
            "or a path to an MJCF or URDF"
        ) from None
    cache.clone_to_cache = _only_cached(name, repositories)
    try:
        module = importlib.import_module(f"robot_descriptions.{name}")
    except ImportError:
        raise StictionError(
            f"robot {name!r}: robot_descriptions has no such model: expected one of its names"
        ) from None
    finally:
        cache.clone_to_cache = clone
    path = getattr(module, "MJCF_PATH", None) or getattr(module, "URDF_PATH", None)
    if path is None or not Path(path).is_file():
        raise StictionError(f"robot {name!r}: {path or 'no MJCF or URDF'}: expected a file there")
    return Path(path)


def _only_cached(name: str, repositories: Descriptions) -> Callable[..., str]:
    """Return a `clone_to_cache` that finds repositories in the cache, and clones none."""

    def cached(repository: str, commit: str | None = None) -> str:
        own = os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")
        place = repositories[repository].cache_path
        folder = Path(own).expanduser() / (place if commit is None else f"{place}-{commit}/{place}")
        if not folder.is_dir():
            raise StictionError(
                f"robot {name!r}: {folder} is not there: expected a cached model; to download it: "
                f"python -c 'import robot_descriptions.{name}'"
            )
        return str(folder)

    return cached
