"""What modules that write an example to try the tool with share: command line, logs as CSV."""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import StictionError

Array = NDArray[np.float64]


def log_csv(t: Array, *, digits: int = 6, **channels: Array) -> str:
    """Return time (T,) and channels (T, n) by name as columns: ``t,q1..qn,tau1..taun``."""
    names = [f"{k}{j + 1}" for k, x in channels.items() for j in range(x.shape[1])]
    text, header = io.StringIO(), ",".join(["t", *names])
    table = np.column_stack([t, *channels.values()])
    np.savetxt(text, table, fmt=f"%.{digits}f", delimiter=",", header=header, comments="")
    return text.getvalue()


def run_writer(
    module: str,
    description: str,
    write: Callable[[Path], None],
    written: str,
    arguments: Sequence[str] | None,
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
