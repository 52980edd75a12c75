"""``stiction check``: what is wrong in torque tables, joint logs and servo logs."""

from __future__ import annotations

import argparse
from pathlib import Path

from stiction_envs.cli import common
from stiction_envs.reporting.json_text import JsonRecord

EXIT_CODES = (
    "exit codes of check: 0 nothing wrong (remarks do not count), 1 defects found,\n"
    "2 bad usage: no such file, or neither a torque table nor a log"
)


def add_parser(subparsers: common.Subparsers) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "check",
        summary="List what is wrong in torque tables, joint logs and servo logs, one line each.",
        example="stiction check base.csv log.csv --robot panda",
        interrupted="run the same command again",
        run=run,
        show=show,
    )
    parser.epilog = f"{parser.epilog}\n{EXIT_CODES}"
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="torque tables (as sje.csv or final.csv) or logs of joints",
    )
    parser.add_argument(
        "--robot",
        metavar="ROBOT",
        help=f"whose logs these are, for units and limits: {common.robot_help()}",
    )
    common.add_chain_option(parser)
    common.add_bag_options(parser)
    common.add_drive_option(parser)
    common.add_units_options(parser)
    common.add_shared_options(parser, out="write findings.csv there too (default: nothing)")


def run(args: argparse.Namespace) -> dict[str, object]:
    """Check; write ``findings.csv`` where asked to."""
    from stiction_envs.measured.checks.files import check

    folder = None
    if args.out is not None:
        inputs = {f"file{k}": path for k, path in enumerate(args.files, 1)}
        inputs |= common.calibration_input(args)
        folder = common.output_folder(args, "", inputs)
    result = check(
        *args.files,
        robot=args.robot,
        chain=args.chain,
        joints=args.joints,
        topic=args.topic,
        drive=args.drive,
        units=args.units,
        calibration=args.calibration,
        columns=args.columns,
    )
    if folder is not None:
        with common.working(), folder:
            result.write(folder.path)
    count = len(result.defects)
    return {
        "command": "check",
        **result.to_json(),
        "failed": f"{count} defect{'s' * (count > 1)} found" if count else None,
    }


def show(result: JsonRecord) -> str:
    """Return the findings, one in a line."""
    from stiction_envs.measured.checks.files import describe

    return describe(result["findings"])
