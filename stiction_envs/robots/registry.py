"""Registered arms, and the files that describe each.

An arm is data in a folder: ``robots/NAME.xml`` (MJCF; outside the package a URDF too),
``robots/NAME.toml`` (title, sources, limits, interface, and what other rooms need of it) and,
where its friction is known, ``friction/NAME.toml``. The package is such a folder, and
:func:`register_arm_folder` adds others. Nothing here imports MuJoCo, so that it loads fast.

A folder of MuJoCo Menagerie stands for its arm: ``scene.xml`` puts a floor and light around the arm
that it includes. `robot_descriptions` names models and clones their repositories into its cache;
only models in the cache are used, and nothing is downloaded.
Sources: google-deepmind/mujoco_menagerie; robot_descriptions, _cache.py.
"""

import importlib
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from stiction_envs.errors import StictionError, missing_extra
from stiction_envs.robots.arm_toml import Table, read_toml

PACKAGE = Path(__file__).resolve().parents[1]
Descriptions = Any  # of robot_descriptions, an extra that has no types
SCENE = "scene.xml"
ENDS = (".xml", ".mjcf", ".urdf")
_DESCRIPTION = re.compile(r"\w+_description")


@dataclass(frozen=True)
class ArmFiles:
    """The files that describe one arm, and the contents of its TOML."""

    name: str
    model: Path
    """MJCF or URDF."""

    @property
    def toml(self) -> Path:
        """Limits, rest pose, interface, sources."""
        return self.model.with_suffix(".toml")

    @property
    def friction(self) -> Path:
        """Friction parameters; the file need not exist."""
        return self.model.parents[1] / "friction" / f"{self.name}.toml"

    @property
    def shipped(self) -> bool:
        """True if the arm comes with the package."""
        return self.model.parents[1] == PACKAGE

    @cached_property
    def table(self) -> Table:
        """The parsed TOML."""
        return read_toml(self.toml)

    @property
    def title(self) -> str:
        """For headings: the TOML's ``short_title``, else its ``title``, else the name."""
        return str(self.table.get("short_title") or self.table.get("title") or self.name)

    @property
    def environment(self) -> str | None:
        """Prefix of its environments' ids: ``Panda`` for ``PandaSJE-v0``; None for none."""
        name = self.table.get("environment")
        if name is not None and not (isinstance(name, str) and re.fullmatch(r"\w+", name)):
            raise StictionError(f"{self.toml}: environment {name!r}: expected letters and digits")
        return name


_arms: dict[str, ArmFiles] = {}
_listeners: list[Callable[[ArmFiles], None]] = []
ARMS: Mapping[str, ArmFiles] = MappingProxyType(_arms)


def register_arm_folder(folder: str | Path) -> tuple[str, ...]:
    """Register the arms of a folder by name, until the process ends; return their names, sorted.

    Each works like an arm of the package: ``load_arm(NAME)``, ``stiction sje NAME`` and, where its
    TOML has ``environment``, ``<environment>SJE-v0`` and ``<environment>GTE-v0``. The folder holds
    ``robots/NAME.xml`` with ``robots/NAME.toml``, and maybe ``friction/NAME.toml``; without it the
    friction is that of ``generic.toml``.

    Raises:
        StictionError: no arm there, an unreadable TOML, or a name that is taken.
    """
    room = Path(folder).expanduser().resolve() / "robots"
    files = sorted(p for p in room.glob("*") if p.suffix.lower() in ENDS)
    found = [ArmFiles(p.stem, p) for p in files if p.with_suffix(".toml").is_file()]
    if not found:
        raise StictionError(f"{room}: no arm: expected NAME.xml and NAME.toml")
    new: dict[str, ArmFiles] = {}
    for arm in found:
        if ARMS.get(arm.name) == arm:
            continue  # a folder may be registered twice
        if arm.name in {**ARMS, **new} or not re.fullmatch(r"[\w-]+", arm.name):
            raise StictionError(
                f"{arm.model}: arm {arm.name!r}: expected letters, digits, - and _, and a name "
                f"other than {', '.join([*ARMS, *new])}"
            )
        taken = [a.environment for a in [*ARMS.values(), *new.values()] if a.environment]
        if arm.environment in taken:
            raise StictionError(
                f"{arm.toml}: environment {arm.environment!r}: expected a name other than "
                f"{', '.join(taken)}"
            )
        new[arm.name] = arm
    _arms.update(new)
    for arm in new.values():
        for listener in _listeners:
            listener(arm)
    return tuple(arm.name for arm in found)


def known_arm(robot: str | Path) -> ArmFiles | None:
    """Return the registered arm of a name or a model file; None for any other file.

    A file is identified by its content, not by its name. A copy of an arm of the package is that
    arm, unless another TOML is beside it; another robot's ``panda.xml`` is not the Panda.
    """
    if str(robot) in ARMS:
        return ARMS[str(robot)]
    path = Path(find_model(robot)).expanduser()
    if not path.is_file():
        return None
    return next((arm for arm in ARMS.values() if _same_files(path, arm)), None)


def _same_files(path: Path, arm: ArmFiles) -> bool:
    if not arm.shipped:  # its model may name other files, which a copy may lack
        return path.samefile(arm.model)
    table = path.with_suffix(".toml")
    pairs = [(path, arm.model), *([(table, arm.toml)] if table.is_file() else [])]
    return all(one.read_bytes() == two.read_bytes() for one, two in pairs)


def robot_files(robot: str | Path) -> dict[str, Path]:
    """Return a robot's files that exist: ``robot`` (MJCF, URDF), ``robot_table`` (its TOML)."""
    known = ARMS.get(str(robot))
    path = Path(find_model(robot)).expanduser() if known is None else known.model
    if not path.name:  # "." or "/"
        return {}
    found = {"robot": path, "robot_table": path.with_suffix(".toml")}
    return {k: v for k, v in found.items() if v.is_file()}


def on_arm(listener: Callable[[ArmFiles], None]) -> None:
    """Call ``listener`` for every arm known now, and for each that is registered later."""
    for arm in ARMS.values():
        listener(arm)
    if listener not in _listeners:
        _listeners.append(listener)


def arm_title(name: str) -> str:
    """Return the title of a registered arm; for a user's file, its name."""
    return ARMS[name].title if name in ARMS else name


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
    except (ImportError, AttributeError):  # not there, or another version
        raise missing_extra(f"robot {name!r}", "robot_descriptions", "descriptions") from None
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
                f"robot {name!r}: {folder} is missing: expected a cached model; to download it: "
                f"python -c 'import robot_descriptions.{name}'"
            )
        return str(folder)

    return cached


BUILTIN = register_arm_folder(PACKAGE)
