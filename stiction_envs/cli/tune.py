"""``stiction tune``: the dither that frees an arm, by the thesis's protocol."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Any

from stiction_envs.cli import common
from stiction_envs.cli.folder import OutputFolder, default_folder, provenance
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
    friction = common.read_friction(arm, args.friction)
    table = None
    if args.table is not None:
        from stiction_envs.measured import read_base

        table = read_base(args.table, arm.name if arm.registered else None, arm.n)
    warned = _check_frequencies(args.frequencies or (), arm.controller_rate_hz)
    inputs = common.input_files(arm, args, table=args.table)
    folder = OutputFolder(
        args.out or default_folder("tune", arm.name),
        provenance(args, inputs),
        force=args.force,
        resumable=True,
    )

    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from tuning.tune import tune

    # whatever is wrong with arm and friction is found before a file is touched
    SingleJointExperiment.of(arm, friction=friction, seed=args.seed, nthread=args.threads)
    try:
        with Progress() as progress, folder:
            result = tune(
                arm,
                out=folder.path,
                table=table,
                frequencies=None if args.frequencies is None else tuple(args.frequencies),
                scales=None if args.scales is None else tuple(args.scales),
                iterations=args.iterations,
                scatter=not args.no_scatter,
                seed=args.seed,
                storage=args.storage,
                study=args.study,
                sampler=args.sampler,
                friction=friction,
                nthread=args.threads,
                progress=progress.set,
            )
    except StictionError as error:
        if folder.resumed or folder.wrote:  # it had begun to work
            raise common.Failed(str(error)) from error
        raise
    for text in result.get("warnings", ()):
        if text not in warned:
            warnings.warn(text, stacklevel=1)
    return {"command": "tune", "out": str(folder.path), **result}


def _check_available(args: argparse.Namespace) -> None:
    for option, names in AVAILABLE.items():
        value = getattr(args, option)
        if value not in names:
            raise StictionError(
                f"--{option} {value} does not exist yet with --protocol {args.protocol}: "
                f"available is {', '.join(names)}"
            )


def _check_frequencies(frequencies: list[float] | tuple[()], rate_hz: float) -> list[str]:
    """Warn of frequencies from half the controller's rate on; return the warnings.

    Raises:
        StictionError: a frequency above the rate, or one that repeats.
    """
    from stiction_envs.dither.aliasing import check_frequency

    if len(set(frequencies)) != len(frequencies):
        raise StictionError("--frequencies: each is allowed once")
    found = [w for f in frequencies if (w := check_frequency(f, rate_hz)) is not None]
    for text in found:
        warnings.warn(text, stacklevel=1)
    return found


def show(result: dict[str, Any]) -> str:
    """Return the result as a readable table."""
    lines = [f"{'joint':<8}{'frequency [Hz]':>16}{'amplitude [N·m]':>18}"]
    lines += [
        f"{r['joint']:<8}{r['frequency_hz']:>16g}{r['amplitude_nm']:>18.4f}"
        for r in result.get("final", ())
    ]
    mean = result.get("mean_reduction_percent")
    if mean is not None:
        lines.append(f"torque to move a joint, mean over all configurations: {-mean:+.1f} %")
    return "\n".join([*lines, f"written to {result['out']}"])
