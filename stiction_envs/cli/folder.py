"""Output folders: never another run's files, always a `provenance.json` that says what made them.

folder = OutputFolder(path, provenance(...), force=args.force)   # raises, writes nothing
with folder:                                                     # makes the folder
    write(folder.path / "sje.csv")                               # on success lists the files
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import json
import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import stiction_envs
from stiction_envs.cli.common import plain
from stiction_envs.errors import StictionError
from stiction_envs.reporting.atomic import write_text_atomic

NAME = "provenance.json"
PACKAGES = ("stiction-envs", "mujoco", "numpy", "scipy", "gymnasium", "optuna", "pin")
NOT_RECORDED = {
    *("command", "run", "show", "interrupted"),  # the program's own
    *("out", "force", "json", "threads", "slots", "seed"),  # seed stands alone; no result has these
}


def versions() -> dict[str, str | None]:
    """Return the versions a result depends on; None for a package that is not installed."""
    out: dict[str, str | None] = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            out[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            out[name] = None
    out["stiction-envs"] = stiction_envs.__version__
    return out


@functools.cache
def git_commit() -> str | None:
    """Return the commit of the checkout this package runs from, "-dirty" if it was changed.

    None for an installed package, also where its environment lies in somebody's repository.
    """
    root = Path(stiction_envs.__file__).resolve().parent.parent

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
    """Return the hash of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def provenance(args: argparse.Namespace, inputs: dict[str, Path]) -> dict[str, Any]:
    """Return what makes a result: versions, commit, seed, arguments and hashes of input files.

    No time and no place of output: the same run gives the same text. ``arguments_sha256`` tells
    one run from another by command, seed, arguments and the content of the inputs.
    """
    arguments = {k: plain(v) for k, v in vars(args).items() if k not in NOT_RECORDED}
    files = {k: {"file": str(v), "sha256": sha256(v)} for k, v in sorted(inputs.items())}
    package = Path(stiction_envs.__file__).resolve().parent
    for k, v in inputs.items():
        if v.resolve().is_relative_to(package):  # where it is installed does not matter
            files[k]["file"] = f"stiction_envs/{v.resolve().relative_to(package).as_posix()}"
    identity = {
        "command": args.command,
        "seed": args.seed,
        "arguments": {k: v for k, v in arguments.items() if k not in inputs},
        "inputs": {k: v["sha256"] for k, v in files.items()},
    }
    text = json.dumps(identity, sort_keys=True)
    return {
        "command": args.command,
        "arguments": arguments,
        "arguments_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "seed": args.seed,
        "inputs": files,
        "git_commit": git_commit(),
        "versions": versions(),
    }


def check_place(path: Path) -> None:
    """Raise if nothing can be written at ``path``."""
    there = path
    while not there.exists() and there != there.parent:
        there = there.parent
    if there != path and not there.is_dir():
        raise StictionError(f"--out {path}: {there} is not a folder")
    if not os.access(there, os.W_OK):
        raise StictionError(f"--out {path}: no permission to write in {there}")


class OutputFolder:
    """The folder of one run."""

    def __init__(
        self, path: Path, found: dict[str, Any], *, force: bool = False, resumable: bool = False
    ) -> None:
        """Check the folder; nothing is written yet.

        Args:
            path: the folder; it need not exist.
            found: `provenance` of the run.
            force: whether another run's files are replaced.
            resumable: whether the same run may go on in its own folder.

        Raises:
            StictionError: the folder holds files, or cannot be one.
        """
        self.path = path
        self._found = found
        self._force = force
        if path.exists() and not path.is_dir():
            raise StictionError(f"--out {path}: is a file: allowed is a folder")
        check_place(path)
        there = self._names()
        before = self._read()
        same = before.get("arguments_sha256") == found["arguments_sha256"]
        self.resumed = bool(resumable and same and not force)
        if there and not force and not self.resumed:
            what = f"a run of stiction {before['command']}" if before.get("command") else "files"
            raise StictionError(f"--out {path}: holds {what}: choose another folder, or --force")
        if self.resumed:
            self._foreign = set(before.get("kept", []))
        else:
            self._old = self._run_files(before, there)
            self._foreign = there - {n.split("/")[0] for n in self._old} - {NAME}

    def __enter__(self) -> Self:
        self._made = not self.path.exists()
        self.path.mkdir(parents=True, exist_ok=True)
        if not self.resumed:
            self._remove(self._old)
        self._before = self._names()
        if not self.resumed:
            self._write({"finished": False, "kept": sorted(self._foreign)})
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            files = self._below(self._names() - self._foreign - {NAME})
            self._write({"finished": True, "kept": sorted(self._foreign), "files": files})
        elif not self.wrote and not self.resumed:
            (self.path / NAME).unlink(missing_ok=True)
            if self._made:
                self.path.rmdir()

    @property
    def wrote(self) -> bool:
        """Whether the run has put a file into the folder."""
        return bool(self._names() - self._before - {NAME})

    def _names(self) -> set[str]:
        return {p.name for p in self.path.iterdir()} if self.path.is_dir() else set()

    def _below(self, names: set[str]) -> list[str]:
        """Return the files of these names, and those in the folders of these names."""
        found = []
        for name in names:
            top = self.path / name
            files = [p for p in top.rglob("*") if p.is_file()] if top.is_dir() else [top]
            found += [p.relative_to(self.path).as_posix() for p in files]
        return sorted(found)

    def _remove(self, files: list[str]) -> None:
        for name in files:
            file = self.path / name
            file.unlink(missing_ok=True)
            for folder in file.relative_to(self.path).parents[:-1]:
                if not any((self.path / folder).iterdir()):
                    (self.path / folder).rmdir()

    def _read(self) -> dict[str, Any]:
        try:
            found = json.loads((self.path / NAME).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _run_files(self, before: dict[str, Any], there: set[str]) -> list[str]:
        """Return the files of an earlier run: those it listed, or all but what it found there."""
        if before.get("finished"):
            here = self.path.resolve()
            return [
                name
                for name in before.get("files", [])
                if (here / name).is_file() and (here / name).resolve().is_relative_to(here)
            ]
        return self._below(there - set(before["kept"]) - {NAME}) if "kept" in before else []

    def _write(self, state: dict[str, Any]) -> None:
        text = json.dumps({**self._found, **state}, indent=2, ensure_ascii=False, sort_keys=True)
        write_text_atomic(self.path / NAME, text + "\n")


def default_folder(command: str, robot: str) -> Path:
    """Return ``runs/<command>-<robot>``."""
    return Path("runs") / f"{command}-{robot}"
