"""Check measured torque tables: ``python -m stiction_envs.measured.checks [TABLE.csv ...]``.

Prints a line for each defect: percentages that do not follow from their torques, amplitudes that
are not base × scale, repetitions that contradict, impossible signs, sizes and units. Without a file
it checks the thesis's own tables. Several files are also checked against each other. Exit code: 0
nothing is wrong (remarks may have been printed), 1 something is, 2 bad input.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from stiction_envs.errors import StictionError
from stiction_envs.measured.checks.tables import check_files, check_thesis


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m stiction_envs.measured.checks",
        description="List what is wrong in torque tables (SJE tables, or thesis-like CSVs).",
        epilog="exit code: 0 nothing wrong (remarks do not count), 1 defects found, 2 bad input",
    )
    parser.add_argument("table", nargs="*", metavar="TABLE.csv", help="default: the thesis's own")
    paths = parser.parse_args(argv).table
    try:
        found = check_files(paths) if paths else check_thesis()
    except StictionError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for defect in found:
        print(defect)
    return int(any(defect.kind != "remark" for defect in found))


if __name__ == "__main__":
    sys.exit(main())
