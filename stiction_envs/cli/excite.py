"""``stiction excite``: a motion to run on a robot so that its dynamics can be identified."""

import argparse

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress

OPTIONS = ("base_frequency", "harmonics", "periods", "clearance")


SUMMARY = "Find a motion within all limits that excites an arm's dynamics well."
EXAMPLE = "stiction excite panda --sweeps --out runs/excite-panda"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    common.add_robot_options(parser, friction=False)
    common.option(
        parser,
        "--base-frequency HZ",
        "base frequency of the Fourier series, the inverse of its period (default: 0.1)",
    )
    common.option(parser, "--harmonics N", "harmonics of the series (default: 5)", common.whole(2))
    common.option(parser, "--periods P", "periods of the series (default: 2)")
    common.option(
        parser,
        "--clearance M",
        "minimum distance to the floor at z = 0 and between links [m] (default: 0.05)",
    )
    common.option(parser, "--sweeps", "add slow sweeps in both directions, for friction")
    common.option(
        parser,
        "--rate HZ",
        "samples per second of trajectory.csv (default: the robot's controller rate)",
    )
    common.add_shared_options(parser, out="output folder (default: runs/excite-ROBOT)")


def run(args: argparse.Namespace) -> common.Answer:
    """Search; write ``trajectory.csv``, ``excitation.json``, a plot and provenance."""
    arm = common.read_arm(args)

    from stiction_envs.identification.excitation import excite
    from stiction_envs.identification.settings import excitation_settings
    from stiction_envs.method_settings import override
    from stiction_envs.robots.registry import robot_files

    given = {k: getattr(args, k) for k in OPTIONS if getattr(args, k) is not None}
    settings = override(excitation_settings(), given)
    folder = common.output_folder(args, arm.name, robot_files(args.robot))
    with common.working(), Progress("per cent") as progress:
        motion = excite(
            arm,
            settings,
            sweeps=args.sweeps,
            rate_hz=args.rate,
            seed=args.seed,
            progress=lambda stage, part: progress.set(stage, 100 * part, 100),
        )
        with folder:
            motion.write(folder.path)
    return common.Answer(result=motion, out=folder.path, files="trajectory.csv")
