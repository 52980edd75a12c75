"""The command line of modules that write an example to try the tool with."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from stiction_envs.errors import StictionError


def run_writer(
    module: str,
    description: str,
    write: Callable[[Path], None],
    written: str,
    arguments: Sequence[str] | None = None,
) -> int:
    """Write an example into the folder that the command line names.

    Args:
        module: that is run, ``python -m MODULE``.
        description: for its help.
        write: writes into a new folder.
        written: what the command says of it.
        arguments: None for those of the process.

    Returns:
        The exit code: 0 done, 2 bad input.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=description)
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path("example"), help="default: example"
    )
    folder = parser.parse_args(arguments).folder
    try:
        write(folder)
    except StictionError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    print(f"written to {folder}: {written}")
    return 0
