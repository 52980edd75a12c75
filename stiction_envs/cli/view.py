"""``stiction view``: push the joints of an arm that sticks, in MuJoCo's viewer."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from stiction_envs.cli import common

if TYPE_CHECKING:
    from stiction_envs.friction.model import StickingModel
    from stiction_envs.measured.tables import AmplitudeRow

MOST = 0.5
"""Largest amplitude of an arm without a table, over its torque limit [-]; assumed."""


SUMMARY = "Push a sticking joint of an arm, and switch its dither on, in MuJoCo's viewer."
EXAMPLE = "stiction view panda --joint 7"
INTERRUPTED = "the window was closed"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    common.add_robot_options(parser)
    common.option(
        parser,
        "--joint N",
        "joint to push first (default: 1); keys: 1-9 joint, up/down push harder/softer, space "
        "or D dither, R reset",
        default=1,
    )
    common.option(
        parser,
        "--dither TABLE.csv",
        "amplitude table (default: the shipped table of the robot, else amplitudes "
        "proportional to the stiction)",
    )
    common.add_json_and_seed(parser)


def run(args: argparse.Namespace) -> common.Answer:
    """Show the window until it is closed."""
    arm = common.read_arm(args)

    from stiction_envs.envs.render.push_window import KEYS, PushView, PushWindow
    from stiction_envs.experiments.gte.protocol import read_dither
    from stiction_envs.experiments.sje.pushed_joint import PushedJoint
    from stiction_envs.friction.sticking import sticking_model

    sticking = sticking_model(arm, args.friction)
    rows = usual_dither(sticking) if args.dither is None else read_dither(args.dither, arm)
    push = PushedJoint(sticking, dither=rows, seed=args.seed)
    push.choose(args.joint)
    shown = PushView(push)
    window = PushWindow(shown)
    print(f"keys: {KEYS}", file=sys.stderr)
    try:
        window.run(lambda line: print(line, file=sys.stderr))
    finally:
        window.close()
    text = f"{arm.name}: {shown.time:.0f} s simulated"
    return common.Answer(more={"robot": arm.name, "simulated_s": shown.time}, text=text)


def usual_dither(sticking: StickingModel) -> list[AmplitudeRow]:
    """Return the arm's table that is shipped, else dither in proportion to the stiction at rest."""
    from stiction_envs.dither.tables import shipped_table
    from stiction_envs.envs.agents import proportional_table
    from stiction_envs.measured.tables import read_amplitudes

    arm = sticking.arm
    if (shipped := shipped_table(arm.registered_name)) is not None:
        return read_amplitudes(shipped, n_joints=arm.n)
    p = sticking.parameters
    stiction = p.stiction_at(p.load_low).mean(axis=-1)
    return list(proportional_table(stiction, MOST * arm.limits.torque))
