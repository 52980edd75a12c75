"""``stiction evaluate``: policies, tables and rules on the same episodes."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from stiction_envs.envs.registration import EXPERIMENTS
from stiction_envs.errors import StictionError
from tuning.names import EPISODES, GATED, PATHS, POLICIES

if TYPE_CHECKING:
    from tuning.policies.task import Task


SUMMARY = "Evaluate policies, amplitude tables and rules on the same episodes of an environment."
EXAMPLE = "stiction evaluate panda gte --policy none gated runs/train-panda/policy.zip"
INTERRUPTED = "nothing was written; run the same command again"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    add_task_options(parser)
    common.option(
        parser,
        "--policy POLICY ...",
        f"one or more of {', '.join(POLICIES)}, a policy.zip of `stiction train`, or an "
        "amplitude table (.csv); gated: the best shipped gated table",
        required=True,
    )
    common.option(
        parser,
        "--episodes N",
        "episodes of each policy (default: %(default)s)",
        default=EPISODES,
    )
    common.add_shared_options(parser, out="output folder (default: runs/evaluate-ROBOT)")


def add_task_options(parser: common.Parser) -> None:
    """Add the options of an environment: arm, experiment, episodes, arguments."""
    common.add_robot_options(parser)
    common.add_sensing_option(parser)
    common.option(parser, "experiment", "the environment", choices=EXPERIMENTS)
    common.option(
        parser,
        "--trajectory",
        "path of every episode (gte); random: random paths, different in training and evaluation",
        choices=PATHS,
    )
    common.option(
        parser,
        "--stiffness KT KR KN",
        "stiffness in every episode (gte): translational [N/m], rotational [N·m/rad], nullspace",
    )
    common.option(
        parser,
        "--compensation KIND|FILE",
        "friction compensation in every episode, also without dither (gte): a kind of "
        "`stiction gte`, with gains of the model's friction, or tuned gains, final.csv or "
        "final.yaml",
    )
    common.option(
        parser,
        "--env NAME=VALUE ...",
        "arguments of the environment, values as JSON: control_interval_s=0.2 "
        "randomise='{\"friction\": 0.2}'",
        default=[],
    )


def read_task(args: argparse.Namespace, n: int) -> Task:
    """Return the environment of `add_task_options`, for an arm of ``n`` joints."""
    from stiction_envs.control.compensation_files import is_file, read_compensation
    from tuning.policies.task import Task

    arguments = dict(_named(text) for text in args.env)
    for name in ("compensation", "trajectory", "stiffness"):
        if getattr(args, name) is not None and args.experiment != "gte":
            raise StictionError(f"--{name}: not with {args.experiment}")
    for name in ("payload", "chain", "friction", "compensation"):
        if getattr(args, name) is not None:
            arguments[name] = getattr(args, name)
    if args.sensing != common.IDEAL:
        arguments["sensing"] = args.sensing
    if (given := arguments.get("compensation")) is not None and is_file(given):
        arguments["compensation"] = read_compensation(given, None, n)
    if any(args.tilt):
        arguments["tilt"] = tuple(args.tilt)
    fixed = arguments.get("fixed_options", {})
    if not isinstance(fixed, dict):
        raise StictionError(f"--env fixed_options={fixed}: expected a JSON object")
    options = {"trajectory": args.trajectory, "stiffness": args.stiffness and tuple(args.stiffness)}
    if given := {k: v for k, v in options.items() if v is not None}:
        arguments["fixed_options"] = {**given, **fixed}
    return Task(
        robot=args.robot, experiment=args.experiment, arguments=arguments, threads=args.threads
    )


def _named(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise StictionError(f"--env {text}: expected NAME=VALUE")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


def run(args: argparse.Namespace) -> common.Answer:
    """Evaluate; write ``evaluation.csv`` and provenance."""
    from tuning.policies.comparison import check, evaluate_all

    arm = common.read_arm(args)
    task = read_task(args, arm.n)
    check(task, args.policy)
    inputs = common.model_files(args, arm) | policy_files(task.arm_name, args.policy)
    folder = common.output_folder(args, task.arm_name, inputs)
    options = {"episodes": args.episodes, "seed": args.seed}
    with common.working(), Progress("episodes") as progress:
        evaluated = evaluate_all(task, args.policy, progress=progress.set, **options)
    with common.working(), folder:
        evaluated.save(folder.path)
    more = {"seed": args.seed, "rows": list(evaluated.rows)}
    return common.Answer(result=evaluated, out=folder.path, more=more)


def policy_files(robot: str, policies: list[str]) -> dict[str, Path]:
    """Return the policies that are files, by unique names."""
    from stiction_envs.dither.tables import shipped_table

    files = {f"policy {k}": Path(p) for k, p in enumerate(policies, 1) if p not in POLICIES}
    shipped = shipped_table(robot, GATED) if "gated" in policies else None
    return files if shipped is None else {**files, "gated": shipped}
