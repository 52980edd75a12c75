"""``stiction export``: the arm that sticks, as plain MJCF for stock MuJoCo."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stiction_envs.cli import common
from stiction_envs.errors import StictionError


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "export",
        summary="Write the arm with its friction as plain MJCF that sticks in stock MuJoCo.",
        example="stiction export panda --out runs/panda-model",
        interrupted="run the same command again",
        run=run,
        show=show,
    )
    common.add_robot_options(parser)
    parser.add_argument(
        "--from",
        dest="source",
        type=Path,
        metavar="DIR",
        help="take the friction from this folder's model.toml or friction.toml",
    )
    common.add_shared_options(parser, out="output folder (default: runs/export-ROBOT)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write ``model.xml`` and provenance."""
    arm = common.read_arm(args)

    from stiction_envs.friction.export import export, friction_in

    if args.source is not None:
        if args.friction is not None:
            raise StictionError("--from and --friction both name the friction: expected one")
        args.friction = friction_in(args.source)
    folder = common.output_folder(args, arm.name, common.model_files(args))
    result = export(arm, args.friction)
    with common.working(), folder:
        result.write(folder.path)
    return {
        "command": "export",
        "robot": arm.name,
        "out": str(folder.path),
        "model": str(folder.path / "model.xml"),
        "friction": folder.provenance["inputs"]["friction"],
        **result.to_json(),
    }


def show(result: dict[str, Any]) -> str:
    """Return the result as a readable table."""
    from stiction_envs.friction.export import describe

    return f"{describe(result['joints'])}\nwritten to {result['model']}"
