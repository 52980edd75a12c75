"""``python -m benchmarks.thesis``: the thesis simulated beside measured, and why the two differ.

Without a target: all its tables and figures in one folder, or some of them (``--only``).
"""

import argparse
from pathlib import Path
from typing import Any

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError
from stiction_envs.reporting.json_text import JsonRecord

GAP = "gap"
"""The target that is no table or figure of the thesis."""


NAME = "reproduce"
SUMMARY = (
    "Simulate the thesis's tables and figures beside the measured ones; explain the difference."
)
EXAMPLE = "python -m benchmarks.thesis --only 4.6 F.1 --out runs/some"
INTERRUPTED = "run the same command again; gap goes on with the models that it had fitted"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    parser.prog = "python -m benchmarks.thesis"
    parser.add_argument(
        "target",
        nargs="?",
        choices=[GAP],
        help="gap: nested physical models of the dithered torques, joint by joint (default: every "
        "table and figure in one folder with index.html)",
    )
    parser.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="ID",
        help="without a target: some tables and figures, such as 4.6, F.1, table-4.6",
    )
    common.add_experiment_options(parser)
    common.add_shared_options(
        parser,
        out="output folder (default: runs/reproduce-thesis, -ID or -gap); gap goes on with one "
        "that holds a part of the same run",
    )


def run(args: argparse.Namespace) -> common.Answer:
    """Fit the nested models, or draw the thesis's tables and figures; write provenance."""
    if args.target and args.only:
        raise StictionError(f"--only {' '.join(args.only)}: expected without a target ({GAP})")
    found = _gap(args) if args.target else _items(args)
    return common.Answer(more={"seed": args.seed, **found}, text=show(found))


def _items(args: argparse.Namespace) -> dict[str, Any]:
    from benchmarks.thesis.catalogue import chosen, reproduce
    from benchmarks.thesis.studies import Options

    items = chosen(args.only)
    name = "-".join(args.only).replace(".", "_") or "thesis"
    folder = common.output_folder(args, name, {})
    options = Options(
        seed=args.seed,
        iterations=args.iterations,
        scatter=not args.no_scatter,
        threads=args.threads,
    )
    with common.working(), Progress("parts") as progress, folder:
        found = reproduce(items, folder.path, options, progress.set)
    return {"out": str(folder.path), "items": found}


def _gap(args: argparse.Namespace) -> dict[str, Any]:
    """Fit the nested models, or go on with them; write their page."""
    from benchmarks.thesis.nested_models import fit, models, page

    settings = {"dither_fit": Path(fit.__file__).with_name("dither_fit.toml")}
    folder = common.output_folder(args, GAP, settings, resumable=True)
    seeds = [args.seed + k for k in models.SEEDS]
    with common.working(), Progress("steps") as progress, folder:
        nested = models.NestedModels(folder.path, seeds=seeds, processes=args.threads)
        nested.fit(progress.set)
        found = page.write_page(folder.path, nested.models)
    return {"out": str(folder.path), GAP: found}


def show(result: JsonRecord) -> str:
    """Return the results as readable tables."""
    if "items" in result:
        lines = [
            f"{key.replace('-', ' '):<12} {x['compared']}" for key, x in result["items"].items()
        ]
        return "\n".join([*lines, "", f"written to {result['out']}: open index.html"])
    lines = [f"{'held-out error [% of base torque]':<38}{'mean':>6}{'median':>8}"]
    lines += [f"{name:<38}{mean:>6.1f}{median:>8.1f}" for name, mean, median in result[GAP]]
    return "\n".join([*lines, "", f"written to {result['out']}"])
