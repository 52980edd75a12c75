"""``stiction export``: the arm that sticks, as plain MJCF for MuJoCo and other engines."""

import argparse
from pathlib import Path

from stiction_envs.cli import common
from stiction_envs.errors import StictionError

KINDS = ("dcmotor", "frictionloss")


SUMMARY = "Write the arm with its friction as plain MJCF that sticks in stock MuJoCo."
EXAMPLE = "stiction export panda --out runs/panda-model"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    common.add_robot_options(parser, friction=False)
    common.option(
        parser,
        "--friction KIND|FILE.toml",
        "dcmotor (LuGre, sticks; default) or frictionloss (for engines without dcmotor; may "
        "creep); and/or a TOML of `stiction calibrate` (default: the robot's friction)",
        action="append",
        default=[],
    )
    common.option(
        parser,
        "--engine NAME",
        "engine that reads the model: mujoco (default), warp, mjx (frictionloss only) or "
        "newton (dcmotors driven by voltage)",
        default="mujoco",
    )
    common.option(
        parser,
        "--from DIR",
        "take the friction from this folder's model.toml or friction.toml",
        dest="source",
    )
    common.add_shared_options(parser, out="output folder (default: runs/export-ROBOT)")


def run(args: argparse.Namespace) -> common.Answer:
    """Write ``model.xml``, the further files of a Menagerie folder, and provenance."""
    from stiction_envs.errors import unknown
    from stiction_envs.experiments.engines import ENGINES
    from stiction_envs.friction.export import export, friction_in

    if args.engine not in ENGINES:
        raise unknown("engine", args.engine, ENGINES)
    args.friction, args.kind = _friction(args.friction)
    arm = common.read_arm(args)
    motor = ENGINES[args.engine].motor
    if args.source is not None:
        if args.friction is not None:
            raise StictionError("--from and --friction both name the friction: expected one")
        args.friction = friction_in(args.source)
    folder = common.output_folder(args, arm.name, common.model_files(args, arm))
    result = export(arm, args.friction, kind=args.kind, motor=motor)
    with common.working(), folder:
        result.write(folder.path)
    model = folder.path / "model.xml"
    more = {
        "robot": arm.name,
        "model": str(model),
        "friction": folder.provenance["inputs"]["friction"],
        "kind": result.kind,
    }
    text = f"{result}\nfriction: {result.kind}\nwritten to {model}"
    return common.Answer(result=result, out=folder.path, more=more, text=text)


def _friction(given: list[str]) -> tuple[Path | None, str | None]:
    """Return the friction file and the kind of friction among the values of ``--friction``."""
    kinds = [x for x in given if x in KINDS]
    files = [Path(x) for x in given if x not in KINDS]
    if wrong := [x for x in files if x.suffix != ".toml"]:
        raise StictionError(
            f"friction {wrong[0]}: expected one of {', '.join(KINDS)}, or a path to a .toml"
        )
    if len(kinds) > 1 or len(files) > 1:
        raise StictionError(
            f"--friction {' '.join(given)}: expected one kind and one .toml at most"
        )
    return next(iter(files), None), next(iter(kinds), None)
