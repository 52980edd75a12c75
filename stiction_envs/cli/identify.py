"""``stiction identify``: an arm's masses, inertias and friction from measured joint logs."""

import argparse

from stiction_envs.cli import common, log_options
from stiction_envs.cli.progress import Progress

SUMMARY = "Identify an arm's links and friction from logs of an exciting motion."
EXAMPLE = "stiction identify log.csv --robot panda --torque link --out runs/links"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    log_options.add_log_options(parser, logs="+")
    common.add_shared_options(parser, out="output folder (default: runs/identify-ROBOT)")


def run(args: argparse.Namespace) -> common.Answer:
    """Identify; write ``identification.json``, report, model, a plot and provenance."""
    from stiction_envs.robots import load_arm
    from stiction_envs.robots.registry import robot_files

    arm = load_arm(args.robot, chain=args.chain)
    inputs = {f"log{k}": log for k, log in enumerate(args.logs, 1)}
    inputs |= {"calibration": args.calibration, **robot_files(args.robot)}
    folder = common.output_folder(args, arm.name, inputs)

    from stiction_envs.identification.identify import identify

    with Progress("per cent") as progress:
        # an error up to here is one of the logs: bad input
        result = identify(
            args.logs,
            arm,
            torque=args.torque,
            cutoff_hz=args.cutoff,
            **log_options.reading(args),
            progress=lambda stage, part: progress.set(stage, 100 * part, 100),
        )
        with common.working(), folder:
            result.write(folder.path)
    return common.Answer(result=result, out=folder.path, files="model.xml, report.html")
