"""Measured data: the thesis's tables and the user's, checked when they are read."""

from stiction_envs.measured.checks.rules import (
    Defect,
    check_amplitudes,
    check_measurements,
    check_percentages,
    check_repeats,
    check_signs,
    check_sje,
)
from stiction_envs.measured.checks.tables import check_files, check_tables, check_thesis
from stiction_envs.measured.checks.thesis_forms import (
    check_differences,
    check_fits,
    check_growth,
    check_parameters,
    check_units,
)
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
from stiction_envs.measured.thesis_robots import ThesisRobot, thesis_robots
from stiction_envs.measured.thesis_tables import (
    THESIS_TABLES,
    DitheredRow,
    thesis_base,
    thesis_dithered,
    thesis_table,
)

__all__ = [
    "DIRECTIONS",
    "LOADS",
    "THESIS_TABLES",
    "AmplitudeRow",
    "BaseTable",
    "Defect",
    "DitheredRow",
    "SJERow",
    "ThesisRobot",
    "check_amplitudes",
    "check_differences",
    "check_files",
    "check_fits",
    "check_growth",
    "check_measurements",
    "check_parameters",
    "check_percentages",
    "check_repeats",
    "check_signs",
    "check_sje",
    "check_tables",
    "check_thesis",
    "check_units",
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
