"""Tell a torque table from a joint log by the first line of the file."""

import os
from pathlib import Path

from stiction_envs.errors import StictionError
from stiction_envs.measured.csv_text import header_of, refuse_pointer
from stiction_envs.measured.logs.aliases import column_of
from stiction_envs.measured.logs.formats.base import OUR_COLUMNS
from stiction_envs.measured.logs.formats.csv_file import CsvFile, known_header
from stiction_envs.measured.logs.formats.registry import format_of
from stiction_envs.measured.tables import AMPLITUDE_COLUMNS, BASE_COLUMNS, SJE_COLUMNS

TABLE, LOG = "torque table", "joint log"


def file_kind(path: str | os.PathLike[str]) -> str:
    """Return `TABLE` or `LOG`; a file that cannot be read is a `LOG`, whose reader reports why.

    Raises:
        StictionError: the columns are neither's.
    """
    packed = os.fspath(path).lower().endswith(".gz")
    if packed or not isinstance(format_of(Path(path)), CsvFile):
        return LOG
    refuse_pointer(path)
    header = header_of(path)
    # an SJE table has the columns of an amplitude table too
    if any(set(columns) <= set(header) for columns in (AMPLITUDE_COLUMNS, BASE_COLUMNS)):
        return TABLE
    known = set(SJE_COLUMNS) & set(header)
    if len(known) > len(SJE_COLUMNS) / 2:
        return TABLE  # with a column missing, which its reader reports
    mark = known_header(header).mark
    if not header or mark != OUR_COLUMNS.mark or any(map(column_of, header)):
        return LOG
    text = ",".join(header)
    shown = text if len(text) <= 80 else f"{text[:80].rpartition(',')[0]} …"
    raise StictionError(
        f"{path}: neither a torque table nor a joint log, its columns are {shown}: "
        f"expected {','.join(SJE_COLUMNS)} or t,q1..qn with tau1..taun or q_cmd1..q_cmdn"
    )
