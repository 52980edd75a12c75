"""What logs a result was made from: files, or logs that lie in memory already."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stiction_envs.measured.logs.reader import JointLog

Log = str | Path | JointLog


@dataclass(frozen=True)
class LogSources:
    """For a result's provenance; by ``log1``, ``log2`` …, or another word, in their order."""

    names: dict[str, str]
    """File name, or what a log calls its source."""
    files: dict[str, Path]
    """Those that are files."""
    in_memory: dict[str, str]
    """SHA-256 of the numbers of those that are not."""

    def hashes(self, provenance: Mapping[str, Any]) -> dict[str, str]:
        """Return the SHA-256 of every log.

        Args:
            provenance: of a run that had `files` among its inputs.
        """
        read = {k: v["sha256"] for k, v in provenance["inputs"].items()}
        return {k: self.in_memory.get(k) or read[k] for k in self.names}

    def __or__(self, other: LogSources) -> LogSources:
        """Return these and others, which have another word."""
        return LogSources(
            self.names | other.names, self.files | other.files, self.in_memory | other.in_memory
        )


def log_sources(logs: Sequence[Log], word: str = "log") -> LogSources:
    """Return what logs are; by ``word`` and their number."""
    named = {f"{word}{k}": log for k, log in enumerate(logs, 1)}
    names: dict[str, str] = {}
    files: dict[str, Path] = {}
    in_memory: dict[str, str] = {}
    for name, log in named.items():
        if isinstance(log, JointLog):
            names[name] = Path(log.source).name
            in_memory[name] = _sha256(log)
        else:
            names[name], files[name] = Path(log).name, Path(log)
    # what is not there is said by its reader
    return LogSources(names, {k: v for k, v in files.items() if v.is_file()}, in_memory)


def _sha256(log: JointLog) -> str:
    digest = hashlib.sha256()
    for array in (log.t, log.q, log.dq, log.tau):
        digest.update(b"" if array is None else array.tobytes())
    return digest.hexdigest()
