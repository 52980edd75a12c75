"""``stiction diagnose``: what the simulation gets wrong about joint logs or torque tables."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, cast

from stiction_envs.cli import common, log_options
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError

if TYPE_CHECKING:
    from stiction_envs.gap.diagnose import LogOptions


SUMMARY = (
    "Name what a simulation gets wrong about measured joint logs, servo logs or torque "
    "tables, and correct it."
)
EXAMPLE = "stiction diagnose log.csv --robot panda --torque link --out runs/why"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    log_options.add_log_options(parser, logs="*", metavar="LOG|TABLE")
    common.option(
        parser,
        "--poses FILE ...",
        "poses at rest, without time: q1..qn,tau1..taun, one row per pose; logs are optional",
        default=[],
    )
    common.option(
        parser,
        "--check LOG ...",
        "test the model on these logs, which are not used to fit it",
        default=[],
    )
    common.add_drive_option(parser, log_options.LOG_DRIVE)
    common.option(
        parser,
        "--servo-stiffness KP ...",
        "stiffness of position servos [N·m/rad], one, or one per joint (default: unknown; the "
        "nominal simulation follows its commands exactly)",
    )
    common.option(
        parser,
        "--servo-damping KD ...",
        "damping of position servos [N·m·s/rad] (default: unknown; fitted, never a cause)",
    )
    common.option(
        parser,
        "--same-servo",
        "all joints have the same servo: joints without gravity get the others' stiffness",
    )
    common.option(
        parser,
        "--nominal rigid|file|shipped|MODEL.toml",
        "nominal simulation: rigid bodies without friction (default for logs); with friction, "
        "springs and gravcomp of the robot's file (default if the file has any); with the friction "
        "of this package (default for tables); or the model.toml of an earlier diagnosis",
    )
    common.add_mounting_options(parser)
    common.option(
        parser,
        "--rehearse",
        "instead of a diagnosis: hide each cause at three sizes in the motion and noise of "
        "the logs, and report which sizes a diagnosis finds; takes a minute or more per joint and "
        "processor",
    )
    common.option(
        parser, "--rehearse-causes NAME ...", "the causes to hide with --rehearse (default: all)"
    )
    common.add_shared_options(parser, out="output folder (default: runs/diagnose-ROBOT)")


def run(args: argparse.Namespace) -> common.Answer:
    """Diagnose; write ``diagnosis.json``, report, model, plots and provenance."""
    if args.rehearse:
        return _rehearse(args)
    if args.rehearse_causes:
        raise StictionError("--rehearse-causes: expected --rehearse too")
    from stiction_envs.gap.diagnose import Stages, diagnose

    place = common.output_folder(args, common.arm_name(args)).path
    with Progress() as progress:
        say = Stages(progress.whole, check=bool(args.check))
        # an error up to here is one of the data: bad input
        result = diagnose(
            args.logs,
            args.robot,
            **_options(args),
            poses=args.poses,
            check=args.check,
            threads=args.threads,
            progress=say,
        )
        args.nominal = result.nominal_name
        with common.working():
            result.save(place, force=args.force, progress=say)
    more = {"summary": result.summary}
    return common.Answer(result=result, out=place, more=more, files="report.html")


def _options(args: argparse.Namespace) -> LogOptions:
    """Return the options that a diagnosis and a rehearsal share."""
    from stiction_envs.gap.diagnose import DEFAULTS

    given = {k: v for k, v in vars(args).items() if k in DEFAULTS}
    return cast("LogOptions", {**given, "cutoff_hz": args.cutoff})


def _rehearse(args: argparse.Namespace) -> common.Answer:
    """Hide causes in the logs' motion; write ``rehearsal.csv`` and provenance."""
    from stiction_envs.hidden.rehearsal.rehearsal_result import CSV, RUNS
    from stiction_envs.hidden.rehearsal.rehearse import plan
    from stiction_envs.reporting.output_folder import OutputFolder, default_folder

    for option in ("check", "poses"):
        if getattr(args, option):
            raise StictionError(f"--{option}: cannot be used with --rehearse")
    with Progress() as progress:
        planned = plan(
            args.logs,
            args.robot,
            **_options(args),
            causes=args.rehearse_causes,
            progress=progress.whole,
        )
        args.nominal = planned.provenance["arguments"]["nominal"]
        place = args.out or default_folder("diagnose", common.arm_name(args))
        folder = OutputFolder(place, planned.provenance, force=args.force, resumable=True)
        with common.working(), folder:
            result = planned.run(
                threads=args.threads, progress=progress.whole, kept=folder.path / RUNS
            )
            result.write(folder.path)
    return common.Answer(result=result, out=folder.path, files=CSV)
