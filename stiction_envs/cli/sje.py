"""``stiction sje``: the Single Joint Experiment, with and without dither."""

import argparse

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import ExperimentError

LOADS, DIRECTIONS = ("load", "no_load"), ("+", "-")


SUMMARY = "Measure the torque at which joints break away, with and without dither."
EXAMPLE = "stiction sje panda --joint 7 --dither final.csv --out runs/joint7"
INTERRUPTED = "nothing was written; run the same command again"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    common.add_robot_options(parser)
    common.add_drive_option(parser, common.SERVO_DRIVE)
    common.add_sensing_option(parser)
    common.option(parser, "--joint N ...", "joints from 1 (default: all)")
    common.option(parser, "--load ...", "poses (default: both)", choices=LOADS, default=list(LOADS))
    common.option(
        parser, "--direction ...", "default: both", choices=DIRECTIONS, default=list(DIRECTIONS)
    )
    common.option(
        parser,
        "--dither TABLE.csv",
        "amplitude table, joint,frequency_hz,amplitude_nm[,waveform,offset_nm]: measure also "
        "with dither; only the joint under test is dithered",
    )
    common.add_experiment_options(parser)
    common.add_shared_options(parser, out="output folder (default: runs/sje-ROBOT)")


def run(args: argparse.Namespace) -> common.Answer:
    """Run the experiment; write ``sje.csv``, plots and provenance.

    A configuration with a stuck iteration has no torque: it is left out of ``sje.csv``, named in
    the result's ``stuck`` and ``failed``, and the exit code is 1. The others are written.
    """
    arm = common.read_arm(args)
    folder = common.output_folder(
        args, arm.name, {**common.model_files(args, arm), "dither": args.dither}
    )

    from stiction_envs.experiments.sje.experiment import SingleJointExperiment

    experiment = SingleJointExperiment(
        arm,
        friction=args.friction,
        drive=args.drive,
        sensing=args.sensing,
        scatter=not args.no_scatter,
        seed=args.seed,
        threads=args.threads,
    )
    jobs = experiment.jobs(
        args.joint, loads=args.load, directions=args.direction, dither=args.dither
    )
    total = experiment.expected_seconds(jobs, args.iterations)
    with common.working(), Progress() as progress:
        result = experiment.measure(
            jobs,
            iterations=args.iterations,
            progress=lambda seconds: progress.add("sje", seconds, total),
        )
    stuck = result.describe_stuck()
    if not result.rows:
        raise ExperimentError(f"{stuck}: nothing was written")

    with common.working(), Progress("plots") as progress, folder:
        result.write(folder.path, progress=progress.set)
    failed = f"{stuck}: left out of {folder.path / 'sje.csv'}" if stuck else None
    return common.Answer(result=result, out=folder.path, more={"seed": args.seed, "failed": failed})
