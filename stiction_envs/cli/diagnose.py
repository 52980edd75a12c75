"""``stiction diagnose``: what the simulation gets wrong about joint logs or torque tables."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError
from stiction_envs.reporting.json_text import JsonRecord

Given = dict[str, Any]
"""Options by their names, as the parser checked them."""
NEWER = ("drive", "units", "calibration", "servo_stiffness", "servo_damping", "same_servo")
"""Options that are in the run's identity only where they are given."""

VIEWERS = ("rrd", "mcap")
"""Options of files for viewers."""


def add_parser(subparsers: common.Subparsers) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "diagnose",
        summary="Name what a simulation gets wrong about measured joint logs, servo logs or torque "
        "tables, and correct it.",
        example="stiction diagnose log.csv --robot panda --torque link --out runs/why",
        interrupted="run the same command again",
        run=run,
        show=show,
    )
    common.add_log_options(parser, logs="*", metavar="LOG|TABLE")
    parser.add_argument(
        "--poses",
        nargs="+",
        default=[],
        type=Path,
        metavar="FILE",
        help="poses at rest without time: q1..qn,tau1..taun, a pose in a row; with logs or alone",
    )
    parser.add_argument(
        "--check",
        nargs="+",
        default=[],
        type=Path,
        metavar="LOG",
        help="logs that take no part: does the model that is found hold there?",
    )
    common.add_drive_option(parser)
    common.add_units_options(parser)
    parser.add_argument(
        "--servo-stiffness",
        nargs="+",
        type=common.number(0, above=True),
        metavar="KP",
        help="of position servos [N·m/rad], one, or one per joint (default: unknown, and the "
        "simulation that is judged follows its commands exactly)",
    )
    parser.add_argument(
        "--servo-damping",
        nargs="+",
        type=common.number(0),
        metavar="KD",
        help="of position servos [N·m·s/rad] (default: unknown, fitted and not judged)",
    )
    parser.add_argument(
        "--same-servo",
        action="store_true",
        help="all joints have the same servo: those without gravity get the others' stiffness",
    )
    parser.add_argument(
        "--nominal",
        metavar="rigid|shipped|MODEL.toml",
        help="the simulation to judge: rigid bodies without friction (default for logs), with our "
        "friction (default for tables), or what an earlier diagnosis wrote",
    )
    parser.add_argument(
        "--payload",
        **common.PAYLOAD,
        help="known mass on the flange [kg] and its centre of mass in the flange frame [m]",
    )
    parser.add_argument(
        "--tilt",
        **common.TILT,
        help="known inclination of the base: about the world's x, then its y [rad]",
    )
    parser.add_argument(
        "--method",
        choices=("auto", "lsm"),
        default="auto",
        help="lsm adds the thesis's least squares (equation 3.1) beside the tool's result",
    )
    parser.add_argument(
        "--rehearse",
        action="store_true",
        help="instead: hide each cause at three sizes in the motion and noise of the logs, and say "
        "which sizes a diagnosis finds; takes a minute or more per joint and processor",
    )
    parser.add_argument(
        "--rehearse-causes",
        nargs="+",
        metavar="NAME",
        help="the causes to hide with --rehearse (default: all)",
    )
    parser.add_argument(
        "--rrd",
        type=Path,
        metavar="FILE.rrd",
        help="also measured and simulated over time, the causes and the arm in 3-D, for Rerun's "
        "viewer (needs the extra rerun)",
    )
    parser.add_argument(
        "--mcap",
        type=Path,
        metavar="FILE.mcap",
        help="also the same series as messages of ROS 2, for Foxglove and PlotJuggler (needs the "
        "extra ros)",
    )
    common.add_shared_options(parser, out="output folder (default: runs/diagnose-ROBOT)")


def run(args: argparse.Namespace) -> dict[str, object]:
    """Diagnose; write ``diagnosis.json``, report, model, plots and provenance."""
    newer: Given = {name: getattr(args, name) for name in NEWER}
    inputs = common.calibration_input(args)
    for name, value in newer.items():
        if not value:  # digests are those of versions without the option
            delattr(args, name)
    if args.rehearse:
        return _rehearse(args, newer, inputs)
    if args.rehearse_causes:
        raise StictionError("--rehearse-causes: expected --rehearse too")
    # so that digests are those of versions without rehearsals
    del args.rehearse, args.rehearse_causes
    from stiction_envs.gap.diagnose import default_nominal, diagnose
    from stiction_envs.gap.stages import Stages
    from stiction_envs.gap.viewers.files import write_viewer_file
    from stiction_envs.robots.registry import robot_files

    inputs |= common.log_inputs("log", [*args.logs, *args.poses])
    inputs |= common.log_inputs("check", args.check)
    if args.nominal is None:
        args.nominal = default_nominal(args.logs)
    inputs |= {**robot_files(args.robot), "nominal": Path(args.nominal)}
    folder = common.output_folder(args, common.arm_name(args), inputs)
    viewer_files = _viewer_files(args, folder.path)
    with Progress() as progress:
        say = Stages(progress.whole, without=() if args.check else ("check",))
        # an error up to here is one of the data: bad input
        result = diagnose(
            args.logs,
            args.robot,
            **_about_the_logs(args),
            poses=args.poses,
            check=args.check,
            method=args.method,
            **newer,
            threads=args.threads,
            progress=say,
        )
        with common.working(), folder:
            result.write(folder.path, progress=say)
            for path in viewer_files.values():
                write_viewer_file(result.series(), path)
    return {
        "command": "diagnose",
        "out": str(folder.path),
        "summary": result.summary,
        **{name: str(path) for name, path in viewer_files.items()},
        **result.to_json(),
    }


def _viewer_files(args: argparse.Namespace, folder: Path) -> dict[str, Path]:
    """Return the files for viewers by their option, without a dash.

    Raises:
        StictionError: one that cannot be written, or of torque tables.
    """
    from stiction_envs.gap.viewers.files import check_viewer_file
    from stiction_envs.measured.kinds import TABLE, file_kind

    asked = {name: getattr(args, name) for name in VIEWERS if getattr(args, name) is not None}
    for name, path in asked.items():
        for table in (x for x in args.logs if file_kind(x) == TABLE):
            raise StictionError(f"--{name}: {table} is a torque table: expected logs")
        check_viewer_file(path, f".{name}", force=args.force, made=folder)
    return asked


def _about_the_logs(args: argparse.Namespace) -> Given:
    """Return the arguments that a diagnosis and a rehearsal share."""
    same = ("torque", "joints", "topic", "nominal", "payload", "tilt", "chain", "seed")
    return {name: getattr(args, name) for name in same} | {"cutoff_hz": args.cutoff}


def _rehearse(args: argparse.Namespace, newer: Given, inputs: dict[str, Path]) -> dict[str, object]:
    """Hide causes in the logs' motion; write ``rehearsal.csv`` and provenance.

    Args:
        args: of the command.
        newer: options of `NEWER`.
        inputs: the calibration file, where one is given.

    Raises:
        StictionError: an option that a rehearsal does not take.
    """
    from stiction_envs.gap.diagnose import default_nominal
    from stiction_envs.hidden.rehearsal.rehearse import plan
    from stiction_envs.hidden.rehearsal.runs import RUNS
    from stiction_envs.robots.registry import robot_files

    for option, given in (
        ("--check", args.check),
        ("--poses", args.poses),
        ("--method lsm", args.method != "auto"),
        *((f"--{name}", getattr(args, name) is not None) for name in VIEWERS),
    ):
        if given:
            raise StictionError(f"{option}: cannot be used with --rehearse")
    inputs |= common.log_inputs("log", args.logs)
    if args.rehearse_causes is None:
        del args.rehearse_causes
    causes = getattr(args, "rehearse_causes", None)
    if args.nominal is None:
        args.nominal = default_nominal(args.logs)
    inputs |= {**robot_files(args.robot), "nominal": Path(args.nominal)}
    folder = common.output_folder(args, common.arm_name(args), inputs, resumable=True)
    with Progress() as progress:
        planned = plan(
            args.logs,
            args.robot,
            **_about_the_logs(args),
            **newer,
            causes=causes,
            progress=progress.whole,
        )
        with common.working(), folder:
            result = planned.run(
                threads=args.threads, progress=progress.whole, kept=folder.path / RUNS
            )
            result.write(folder.path)
    return {"command": "diagnose", "out": str(folder.path), **result.to_json()}


def show(result: JsonRecord) -> str:
    """Return the verdict and the causes as readable lines."""
    if "rehearsal" in result:
        from stiction_envs.hidden.rehearsal import result as rehearsal

        return f"{rehearsal.describe(result)}\nwritten to {result['out']}: {rehearsal.CSV}"
    from stiction_envs.gap.report.result import describe

    text = describe(result["verdict"], result["summary"], result["causes"])
    also = "".join(f"\nwritten: {result[name]}" for name in VIEWERS if name in result)
    return f"{text}\nwritten to {result['out']}: report.html{also}"
