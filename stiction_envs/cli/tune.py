"""``stiction tune``: the dither that frees an arm, by the thesis's protocol."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError

AVAILABLE = {"protocol": ("thesis",), "sampler": ("grid",), "objective": ("sje",)}
"""What the tuner can do now; the parser knows more names, for what is planned."""


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "tune",
        summary="Find frequency and amplitude of the dither of every joint, and verify them.",
        example="stiction tune panda --protocol thesis --table base.csv --out runs/tune-panda",
        interrupted="what was measured is kept; run the same command again to go on",
        run=run,
        show=show,
    )
    common.add_robot_options(parser)
    parser.add_argument(
        "--protocol",
        choices=("thesis",),
        default="thesis",
        help="frequencies, then scales, then verification (thesis 4.2; default)",
    )
    parser.add_argument(
        "--sampler",
        choices=("grid", "tpe", "gp", "cmaes"),
        default="grid",
        help="how settings are chosen (default: %(default)s; protocol thesis has no other)",
    )
    parser.add_argument(
        "--objective",
        choices=("sje", "gte"),
        default="sje",
        help="what is lowered (default: %(default)s, the breakaway torque; no other yet)",
    )
    parser.add_argument(
        "--table",
        type=Path,
        metavar="TABLE.csv",
        help="measured base torques, in the form of base.csv or thesis Table 4.3: the friction is "
        "calibrated to them first",
    )
    parser.add_argument(
        "--frequencies",
        nargs="+",
        type=common.number(0, above=True),
        metavar="HZ",
        help="frequencies to try (default: the thesis's of that robot)",
    )
    parser.add_argument(
        "--scales",
        nargs="+",
        type=common.number(0, above=True),
        metavar="X",
        help="amplitudes to try, over the base torque (default: 0.8 1.0 1.2)",
    )
    common.add_experiment_options(parser)
    parser.add_argument(
        "--storage", metavar="URL", help="Optuna storage (default: a file in --out)"
    )
    parser.add_argument("--study", metavar="NAME", help="name of the Optuna study")
    common.add_shared_options(
        parser,
        out="output folder (default: runs/tune-ROBOT); one that holds a part of the same run is "
        "continued",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Tune; write tables, report, plots and provenance."""
    _check_available(args)
    arm = common.read_arm(args)
    folder = common.output_folder(
        args, arm.name, {**common.model_files(args), "table": args.table}, resumable=True
    )

    from tuning import tune as tuner

    with Progress() as progress:
        result = tuner.tune(
            arm,
            out=folder,
            table=args.table,
            frequencies=args.frequencies,
            scales=args.scales,
            iterations=args.iterations,
            scatter=not args.no_scatter,
            seed=args.seed,
            storage=args.storage,
            study=args.study,
            sampler=args.sampler,
            friction=args.friction,
            nthread=args.threads,
            progress=progress.set,
        )
    return {"command": "tune", "out": str(folder.path), **result.to_json()}


def _check_available(args: argparse.Namespace) -> None:
    for option, names in AVAILABLE.items():
        value = getattr(args, option)
        if value not in names:
            raise StictionError(
                f"--{option} {value} does not exist yet with --protocol {args.protocol}: "
                f"expected {', '.join(names)}"
            )


def show(result: dict[str, Any]) -> str:
    """Return the result as a readable table."""
    from tuning.tune import describe

    return f"{describe(result)}\nwritten to {result['out']}"
