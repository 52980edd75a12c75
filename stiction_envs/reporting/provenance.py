"""Provenance of a result: versions, git commit, seed, arguments, hashes of the input files."""

import functools
import hashlib
import json
import platform
import subprocess
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import TypedDict

from stiction_envs import version
from stiction_envs.reporting.json_text import plain

PACKAGES = ("stiction-envs", "mujoco", "numpy", "scipy", "gymnasium", "optuna", "pin")
OPTIONAL = ("cmaes", "numba", "scikit-learn", "torch")
"""Packages that decide results where they are installed."""


class Provenance(TypedDict):
    """Contents of ``provenance.json``, as `provenance` makes them."""

    command: str
    arguments: dict[str, object]
    arguments_sha256: str
    seed: int
    inputs: dict[str, dict[str, str]]
    git_commit: str | None
    versions: dict[str, str | None]


def package_folder() -> Path:
    """Return where this package is installed."""
    return Path(version.__file__).resolve().parent


def versions() -> dict[str, str | None]:
    """Return the versions a result depends on.

    None for a package that is not installed; optional ones are there where they are installed.
    """
    out: dict[str, str | None] = {"python": platform.python_version()}
    for name in (*PACKAGES, *OPTIONAL):
        try:
            out[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            if name in PACKAGES:
                out[name] = None
    out["stiction-envs"] = version.__version__
    return out


@functools.cache
def git_commit() -> str | None:
    """Return the commit of the checkout this package runs from, "-dirty" if it was changed.

    None for an installed package, even if its environment is inside another repository.
    """
    root = package_folder().parent

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments],
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
        return done.stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != root:
            return None
        commit = git("rev-parse", "HEAD")
        changed = git("status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.SubprocessError):
        return None
    return commit + ("-dirty" if changed else "")


def sha256(path: Path) -> str:
    """Return the hash of a file's bytes; of a folder, that of its files' names and hashes.

    Videos, which lerobot records beside the numbers, do not count.
    """
    if path.is_dir():
        files = sorted(x for x in path.rglob("*") if x.is_file() and x.suffix != ".mp4")
        text = "\n".join(f"{x.relative_to(path).as_posix()} {sha256(x)}" for x in files)
        return hashlib.sha256(text.encode()).hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def provenance(
    command: str,
    arguments: Mapping[str, object],
    *,
    seed: int,
    inputs: Mapping[str, Path] | None = None,
) -> Provenance:
    """Return the contents of ``provenance.json``.

    It has no time and no output folder: the same run gives the same text. ``arguments_sha256``
    identifies a run by command, seed, arguments and the content of the inputs.

    Args:
        command: name of the command, or of the function it calls.
        arguments: other arguments that change the result, by name.
        seed: of all that is random.
        inputs: files by the name of their argument.
    """
    inputs = {} if inputs is None else inputs
    shown = {k: plain(v) for k, v in arguments.items()}
    files = {k: {"file": str(v), "sha256": sha256(v)} for k, v in sorted(inputs.items())}
    package = package_folder()
    for k, v in inputs.items():
        for ours in (package, package.parent / "tuning"):
            if v.resolve().is_relative_to(ours):  # where it is installed does not matter
                files[k]["file"] = v.resolve().relative_to(package.parent).as_posix()
    identity = {
        "command": command,
        "seed": seed,
        "arguments": {k: v for k, v in shown.items() if k not in inputs},
        "inputs": {k: v["sha256"] for k, v in files.items()},
    }
    text = json.dumps(identity, sort_keys=True)
    return {
        "command": command,
        "arguments": shown,
        "arguments_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "seed": seed,
        "inputs": files,
        "git_commit": git_commit(),
        "versions": versions(),
    }
