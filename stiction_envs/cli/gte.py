"""``stiction gte``: the Generated Trajectory Experiment, with and without what frees joints."""

import argparse
from pathlib import Path

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError

# as the package has them; written out, so that --help does not load the engine
TRAJECTORIES = ("triangle", "pentagon")


SUMMARY = (
    "Follow a path under Cartesian impedance control, with and without dither or "
    "friction compensation."
)
EXAMPLE = "stiction gte panda --trajectory triangle --stiffness 200 20 0 --dither final.csv"
INTERRUPTED = "nothing was written; run the same command again"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    common.add_robot_options(parser)
    common.add_sensing_option(parser)
    names = "|".join(TRAJECTORIES)
    common.option(
        parser,
        f"--trajectory {names}|FILE.csv",
        "path: by name, or goals relative to the start, x,y,z[,roll,pitch,yaw] or "
        "x,y,z,qw,qx,qy,qz [m, rad]",
        required=True,
    )
    common.option(
        parser,
        "--stiffness KT KR KN",
        "translational [N/m], rotational [N·m/rad], nullspace [N·m/rad]",
        required=True,
    )
    common.option(
        parser,
        "--dither TABLE.csv",
        "amplitude table, joint,frequency_hz,amplitude_nm[,waveform,offset_nm,gate_rad_s]: "
        "run also with dither on all joints of the table",
    )
    common.option(
        parser,
        "--compensation KIND|FILE",
        "run also with friction compensation, without and (with --dither) with dither: "
        "feedforward of the reference's motion; push, in the sign of the joint error, fading with "
        "the measured speed; lugre_observer; momentum_observer; or tuned gains, final.csv or "
        "final.yaml",
    )
    common.option(
        parser,
        "--compensation-table FILE.csv",
        "gains of KIND, joint,gain_nm[,speed_rad_s][,error_rad] … (default: gains of the "
        "friction model at the start)",
    )
    common.option(
        parser,
        "--start Q ...",
        "joint angles at the start, one per joint [rad] (default: the robot's rest pose)",
    )
    common.option(
        parser,
        "--tool X Y Z",
        "controlled and measured point, relative to the flange in the hand's frame [m]; "
        "0 0 0.1034 for the Panda's hand (default: the flange)",
    )
    common.add_experiment_options(parser)
    common.add_shared_options(parser, out="output folder (default: runs/gte-ROBOT)")


def run(args: argparse.Namespace) -> common.Answer:
    """Run the experiment; write tables, plots and provenance."""
    arm = common.read_arm(args)

    from stiction_envs.control.compensation_files import is_file
    from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
    from stiction_envs.experiments.gte.protocol import (
        read_dither,
        read_trajectory,
        with_and_without,
    )

    own = read_trajectory(args.trajectory)
    given = args.compensation
    if args.compensation_table is not None and (given is None or is_file(given)):
        raise StictionError(
            "--compensation-table: needs --compensation KIND; not with --compensation FILE, which "
            "has gains"
        )
    dither = () if args.dither is None else read_dither(args.dither, arm)
    inputs = {
        **common.model_files(args, arm),
        "dither": args.dither,
        "compensation_table": args.compensation_table,
        "trajectory": None if own is None else Path(args.trajectory),
    }
    bench = GeneratedTrajectoryExperiment(
        arm,
        friction=args.friction,
        start=args.start,
        tool=args.tool,
        paths={} if own is None else {own.name: own},
        sensing=args.sensing,
        scatter=not args.no_scatter,
        seed=args.seed,
        threads=args.threads,
    )
    compensation = None
    if given is not None:
        compensation = bench.compensation(given, table=args.compensation_table)
    folder = common.output_folder(args, arm.name, inputs)
    cases = with_and_without(
        args.trajectory if own is None else own.name,
        tuple(args.stiffness),
        dither,
        compensation=compensation,
    )
    total = bench.expected_seconds(cases, args.iterations)
    with common.working(), Progress() as progress:
        result = bench.measure(
            cases,
            iterations=args.iterations,
            progress=lambda seconds: progress.add("gte", seconds, total),
        )
    with common.working(), folder:
        result.write(folder.path)
    return common.Answer(result=result, out=folder.path, more={"seed": args.seed, "failed": None})
