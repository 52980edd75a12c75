"""Measured data: the thesis's tables and the user's, checked when they are read."""

from stiction_envs.measured.tables import (
    DIRECTIONS,
    LOADS,
    AmplitudeRow,
    BaseTable,
    SJERow,
    read_amplitudes,
    read_base,
    read_sje,
    write_amplitudes,
    write_final,
    write_sje,
)
from stiction_envs.measured.thesis_tables import (
    THESIS_TABLES,
    DitheredRow,
    thesis_base,
    thesis_dithered,
    thesis_robots,
    thesis_table,
)

__all__ = [
    "DIRECTIONS",
    "LOADS",
    "THESIS_TABLES",
    "AmplitudeRow",
    "BaseTable",
    "DitheredRow",
    "SJERow",
    "read_amplitudes",
    "read_base",
    "read_sje",
    "thesis_base",
    "thesis_dithered",
    "thesis_robots",
    "thesis_table",
    "write_amplitudes",
    "write_final",
    "write_sje",
]
