"""Files for viewers: whether one may be written, and writing it whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from stiction_envs.errors import StictionError
from stiction_envs.gap.viewers import mcap, rrd
from stiction_envs.gap.viewers.series import Series
from stiction_envs.reporting.atomic import write_bytes_atomic
from stiction_envs.reporting.output_folder import check_file

KINDS: dict[str, tuple[Callable[[], None], Callable[[Series], bytes]]] = {
    ".rrd": (rrd.check_package, rrd.rrd_bytes),
    ".mcap": (mcap.check_package, mcap.mcap_bytes),
}
"""Check of its package and content, by suffix."""


def check_viewer_file(
    path: Path, suffix: str, *, force: bool = False, made: Path | None = None
) -> None:
    """Raise if a file of a viewer cannot be written.

    Args:
        path: the file.
        suffix: ``.rrd`` or ``.mcap``.
        force: whether it may replace another.
        made: a folder that will be there.

    Raises:
        StictionError: a package is missing, or the name or place is wrong.
    """
    KINDS[suffix][0]()
    check_file(path, suffix, force=force)
    if not path.parent.is_dir() and (made is None or path.parent.resolve() != made.resolve()):
        raise StictionError(f"output {path}: {path.parent}: expected a folder that is there")


def write_viewer_file(series: Series, path: Path) -> None:
    """Write a file of a kind of `KINDS` at once."""
    write_bytes_atomic(path, KINDS[path.suffix][1](series))
