"""``stiction conformance``: does each joint hold under its stiction, and go over it."""

import argparse

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress

SUMMARY = (
    "Test that each joint holds below its stiction for a minute and moves above it; "
    "exit code 1 if one does not."
)
EXAMPLE = "stiction conformance panda"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    common.option(
        parser,
        "robot ROBOT",
        "name of an arm of this package, or a path to an MJCF whose joints have friction "
        "(`stiction export` writes one)",
    )
    common.add_chain_option(parser)
    common.option(
        parser,
        "--stiction NM ...",
        "stiction of every hinge [N·m], 0 to skip a hinge (default: the model's)",
    )
    common.option(
        parser,
        "--engine NAME",
        "engine of the test: mujoco (default), or one of the extras warp, mjx and newton; for "
        "an extra, a robot's name means the model of `stiction export ROBOT --engine NAME`",
        default="mujoco",
    )
    common.add_shared_options(parser, out="output folder (default: runs/conformance-ROBOT)")


def run(args: argparse.Namespace) -> common.Answer:
    """Test; write ``conformance.csv`` and provenance."""
    from stiction_envs.experiments.conformance import conformance

    place = common.output_folder(args, common.arm_name(args)).path
    with Progress("tests") as progress:
        result = conformance(
            args.robot,
            args.stiction,
            engine=args.engine,
            chain=args.chain,
            threads=args.threads,
            progress=lambda k, n: progress.set("conformance", k, n),
        )
    with common.working():
        result.save(place, force=args.force)
    stuck = [j.name for j in result.joints if not j.passed]
    failed = f"does not stick as it should: {', '.join(stuck)}" if stuck else None
    if result.refused:
        failed = f"{result.engine} refused: {result.refused}"
    more = {"robot": args.robot, "failed": failed}
    return common.Answer(result=result, out=place, more=more, files="conformance.csv")
