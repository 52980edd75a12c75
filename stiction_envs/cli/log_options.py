"""Options of the commands that read logs, and what they read."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, cast

from stiction_envs.cli import common

if TYPE_CHECKING:
    from stiction_envs.measured.logs.joint_names import Reading

LOG_DRIVE = (
    "drive of the joints: torque (tau1..n), or position, by servos that follow commands "
    "(q_cmd1..n) (default: the columns of the log; torque if it has both)"
)


def add_log_options(parser: argparse.ArgumentParser, *, logs: str, metavar: str = "LOG") -> None:
    """Add the joint logs, their robot and how to read them; ``logs`` is their nargs."""
    common.option(
        parser,
        f"logs {metavar}",
        "t,q1..qn[,dq1..dqn],tau1..taun as .csv, .csv.gz, .npz or .parquet; a CSV of "
        "libfranka; a ROS bag (.bag, .mcap, .db3 or folder); all of one robot",
        Path,
        nargs=logs,
    )
    common.option(parser, "--robot ROBOT", common.robot_help(), required=True)
    common.add_chain_option(parser)
    common.option(
        parser,
        "--torque",
        "side of the gear on which tau was measured (Franka, KUKA: link; default: what the "
        "log says, else motor)",
        choices=("motor", "link"),
    )
    add_reading_options(parser)
    common.option(
        parser,
        "--cutoff HZ",
        "cutoff of the zero-phase filter of all signals (default: chosen from the data)",
    )


def add_reading_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of how logs are read: fields of `Reading`."""
    common.option(
        parser,
        "--joints NAME ...",
        "names of joints 1 to n in a log with joint names (default: the robot's names, or numbers)",
        default=[],
    )
    common.option(
        parser, "--topic NAME", "topic to read, if a ROS bag has several with joint states"
    )
    common.option(
        parser,
        "--units",
        "unit of angles; percent is of the calibrated range, ticks are encoder steps "
        "(default: the unit that the log shows, else rad)",
        choices=("rad", "deg", "percent", "ticks"),
    )
    common.option(
        parser,
        "--calibration FILE",
        "lerobot's JSON with the ranges of the motors, for percent and ticks",
    )
    common.option(
        parser,
        "--columns NAME ...",
        "names of a log's columns: all in their order, such as t q1..q6 tau1..tau6 for .npy, "
        "or some of them, such as t=Zeit q1=Winkel (default: standard and well-known names)",
        default=[],
    )


def reading(args: argparse.Namespace) -> Reading:
    """Return how logs are read: the options of `add_reading_options`."""
    from stiction_envs.measured.logs.joint_names import Reading

    return cast("Reading", {name: getattr(args, name) for name in Reading.__annotations__})
