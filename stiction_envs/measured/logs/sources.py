"""Logs that a result was made from: files, or logs in memory."""

import hashlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stiction_envs.errors import StictionError, unknown
from stiction_envs.measured.logs.log_files import is_log
from stiction_envs.measured.logs.robot_log import JointLog, RobotLog
from stiction_envs.reporting.provenance import Provenance

Log = str | Path | RobotLog
SIDES = ("motor", "link")
"""Sides of the gear on which torque can be measured."""


@dataclass(frozen=True)
class LogSources:
    """Logs in a result's provenance, by ``log1``, ``log2`` …, ``check1`` … in their order."""

    names: dict[str, str]
    """File name, or the source of a log in memory."""
    files: dict[str, Path]
    in_memory: dict[str, str]
    """SHA-256 of the numbers of the logs that are not files."""

    def hashes(self, provenance: Provenance) -> dict[str, str]:
        """Return the SHA-256 of every log, by the provenance of a run that read `files`."""
        read = {k: v["sha256"] for k, v in provenance["inputs"].items()}
        return {k: self.in_memory.get(k) or read[k] for k in self.names}


def log_sources(logs: Sequence[Log], check: Sequence[Log] = ()) -> LogSources:
    """Return the sources of logs and of check logs."""
    named = {f"log{k}": log for k, log in enumerate(logs, 1)}
    named |= {f"check{k}": log for k, log in enumerate(check, 1)}
    in_memory = {k: log for k, log in named.items() if isinstance(log, RobotLog)}
    paths = {k: Path(log.source if isinstance(log, RobotLog) else log) for k, log in named.items()}
    return LogSources(
        names={k: path.name for k, path in paths.items()},
        # the reader reports files that are not there
        files={k: path for k, path in paths.items() if k not in in_memory and is_log(path)},
        in_memory={k: _sha256(log) for k, log in in_memory.items()},
    )


def torque_side(asked: str | None, logs: Sequence[JointLog]) -> str:
    """Return the side of the gear on which the torque of logs of one robot was measured.

    ``asked`` is "motor" (which warns where a log says link), "link", or None for what the logs say,
    and motor where they say nothing.

    Raises:
        StictionError: an unknown side, or None for logs of which only some say link.
    """
    if asked is not None and asked not in SIDES:
        raise unknown("torque side", asked, SIDES)
    said = {log.side: log.source for log in logs}
    if asked == "motor" and "link" in said:
        warnings.warn(
            f"torque: that of {said['link']} was measured behind the gear: expected torque link",
            stacklevel=2,
        )
    if asked is not None:
        return asked
    if "link" in said and len(said) > 1:
        raise StictionError(
            f"torque: that of {said['link']} was measured behind the gear (link), "
            f"{said.get(None, said.get('motor'))} does not say: expected torque link or motor"
        )
    return "link" if "link" in said else "motor"


def _sha256(log: RobotLog) -> str:
    digest = hashlib.sha256()
    for array in log.arrays:
        digest.update(b"" if array is None else array.tobytes())
    return digest.hexdigest()
