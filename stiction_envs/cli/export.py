"""``stiction export``: the arm that sticks, as plain MJCF for stock MuJoCo."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stiction_envs.cli import common
from stiction_envs.cli.folder import OutputFolder, default_folder, provenance
from stiction_envs.errors import StictionError

SOURCES = ("model.toml", "friction.toml")
"""Files looked for in ``--from``, the first found counts."""


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
    if args.source is not None:
        if args.friction is not None:
            raise StictionError("--from and --friction both name the friction: allowed is one")
        args.friction = _find(args.source)
    friction = common.read_friction(arm, args.friction)
    used = common.friction_file(arm, args.friction)
    found = provenance(args, common.input_files(arm, args))
    folder = OutputFolder(args.out or default_folder("export", arm.name), found, force=args.force)

    from stiction_envs.friction.model import build
    from stiction_envs.friction.plain_mjcf import plain_mjcf
    from stiction_envs.measured import write_text_atomic

    sticking = build(arm, friction)
    text = plain_mjcf(sticking, friction_name=used.name)
    with common.working(), folder:
        write_text_atomic(folder.path / "model.xml", text)
    return {
        "command": "export",
        "robot": arm.name,
        "out": str(folder.path),
        "model": str(folder.path / "model.xml"),
        "friction": found["inputs"]["friction"],
        "joints": [
            {
                "name": name,
                "stiction_nm": sticking.model.actuator_biasprm[a, 4],
                "coulomb_nm": sticking.model.actuator_biasprm[a, 3],
                "elastic": bool(sticking.spring[i] >= 0),
            }
            for i, (name, a) in enumerate(
                zip(arm.joint_names, sticking.torque_actuator, strict=True)
            )
        ],
    }


def _find(folder: Path) -> Path:
    for name in SOURCES:
        if (folder / name).is_file():
            return folder / name
    raise StictionError(f"--from {folder}: holds neither {' nor '.join(SOURCES)}")


def show(result: dict[str, Any]) -> str:
    """Return the result as a readable table."""
    lines = [f"{'joint':<24}{'stiction [N·m]':>16}{'Coulomb [N·m]':>16}"]
    for j in result["joints"]:
        kind = "  with elastic gear" if j["elastic"] else ""
        lines.append(f"{j['name']:<24}{j['stiction_nm']:>16.4f}{j['coulomb_nm']:>16.4f}{kind}")
    return "\n".join([*lines, f"written to {result['model']}"])
