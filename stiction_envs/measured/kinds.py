"""Torque table or joint log: told from the first line of a file."""

from __future__ import annotations

import csv
import gzip
import os
import re
import zlib
from collections.abc import Sequence
from pathlib import Path

from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.tables import form_of
from stiction_envs.measured.tables import SJE_COLUMNS

TABLE, LOG = "torque table", "joint log"
FIRST_BYTES = 65_536
"""Of a file, in which its header must end."""
_LOG_COLUMN = re.compile(r"t|(q|dq|tau)\d+")


def file_kind(path: str | os.PathLike[str]) -> str:
    """Return `TABLE` or `LOG`.

    Args:
        path: a file; what cannot be read counts as a log, whose reader says why.

    Raises:
        StictionError: the columns are neither's.
    """
    name = Path(path).name.lower()
    if not name.endswith((".csv", ".csv.gz")):
        return LOG
    header = header_of(path)
    if form_of(header) is not None:
        return TABLE
    if not header or any(_LOG_COLUMN.fullmatch(c) for c in header):
        return LOG
    known = set(SJE_COLUMNS) & set(header)
    if len(known) > len(SJE_COLUMNS) / 2:
        return TABLE  # with a column missing, as its reader says
    raise StictionError(
        f"{path}: neither a torque table nor a joint log, its columns are {_short(header)}: "
        f"expected {','.join(SJE_COLUMNS)} or t,q1..qn,tau1..taun"
    )


def header_of(path: str | os.PathLike[str]) -> list[str]:
    """Return the columns of a CSV, compressed or not; none if it cannot be read."""
    path = Path(path)
    try:
        with gzip.open(path) if path.name.lower().endswith(".gz") else path.open("rb") as file:
            text = file.read(FIRST_BYTES).decode("utf-8-sig", errors="replace")
    except (OSError, EOFError, zlib.error):
        return []
    line = next((x for x in text.splitlines() if x.strip()), "")
    return [cell.strip() for cell in next(csv.reader([line]), [])] if line else []


def _short(header: Sequence[str]) -> str:
    text = ",".join(header)
    return text if len(text) <= 80 else f"{text[:80]}…"
