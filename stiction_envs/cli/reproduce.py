"""``stiction reproduce``: the thesis simulated beside measured, and why the two differ.

Without a target: all its tables and figures in one folder, or some of them (``--only``).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError
from tuning.reproduce import SEEDS, TARGETS, Request, in_order, inputs_of, reproduce


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "reproduce",
        summary="Simulate the thesis's tables and figures beside the measured ones; explain the "
        "difference.",
        example="stiction reproduce --only 4.6 F.1 --out runs/some",
        interrupted="what was done is kept; run the same command again to go on",
        run=run,
        show=show,
    )
    parser.add_argument(
        "targets",
        nargs="*",
        metavar="TARGET",
        type=_target,
        help="; ".join(f"{name}: {target.help}" for name, target in TARGETS.items())
        + " (default: none of them, but every table and figure in one folder with index.html)",
    )
    parser.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="ID",
        help="without a target: some tables and figures, such as 4.6, F.1, table-4.6",
    )
    parser.add_argument(
        "--seeds",
        type=common.whole(1),
        default=SEEDS,
        metavar="K",
        help="gap: seeds of the optimiser, from --seed on (default: %(default)s)",
    )
    common.add_experiment_options(parser)
    common.add_shared_options(
        parser,
        out="output folder (default: runs/reproduce-TARGETS, runs/reproduce-thesis); one that "
        "holds a part of the same run is continued",
    )


def _target(name: str) -> str:
    if name not in TARGETS:
        raise argparse.ArgumentTypeError(f"{name!r}: expected one of {', '.join(TARGETS)}")
    return name


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run the targets, or draw the thesis's tables and figures; write provenance."""
    if args.targets and args.only:
        raise StictionError(
            f"--only {' '.join(args.only)}: expected without a target ({', '.join(TARGETS)})"
        )
    return _targets(args) if args.targets else _items(args)


def _items(args: argparse.Namespace) -> dict[str, Any]:
    from stiction_envs.thesis.catalogue import chosen
    from tuning.whole import inputs_of_items, reproduce_items

    items = chosen(args.only)
    name = "-".join(args.only).replace(".", "_") or "thesis"
    args.only = [item.key for item in items]  # the same run, however asked for
    folder = common.output_folder(args, name, inputs_of_items(items), resumable=True)
    request = Request(
        seed=args.seed,
        iterations=args.iterations,
        scatter=not args.no_scatter,
        nthread=args.threads,
    )
    with common.working(), Progress() as progress:
        found = reproduce_items(args.only, folder, request, tell=progress.whole)
    return {"command": "reproduce", "seed": args.seed, "out": str(folder.path), "items": found}


def _targets(args: argparse.Namespace) -> dict[str, Any]:
    args.targets = in_order(args.targets)
    name = "all" if len(args.targets) == len(TARGETS) else "-".join(args.targets)
    folder = common.output_folder(args, name, inputs_of(args.targets), resumable=True)
    with common.working(), Progress() as progress:
        results = reproduce(
            args.targets,
            folder,
            Request(
                seed=args.seed,
                seeds=args.seeds,
                iterations=args.iterations,
                scatter=not args.no_scatter,
                nthread=args.threads,
                tell=progress.set,
            ),
        )
    return {
        "command": "reproduce",
        "seed": args.seed,
        "out": str(folder.path),
        "targets": results,
    }


def show(result: dict[str, Any]) -> str:
    """Return the results as readable tables."""
    if "items" in result:
        return _show_items(result)
    lines: list[str] = []
    for target, found in result["targets"].items():
        lines += SHOWN[target](found)
        lines.append("")
    return "\n".join([*lines, f"written to {result['out']}"])


def _show_items(result: dict[str, Any]) -> str:
    lines = [f"{key.replace('-', ' '):<12} {x['brief']}" for key, x in result["items"].items()]
    return "\n".join([*lines, "", f"written to {result['out']}: open index.html"])


def _show_gap(found: dict[str, Any]) -> list[str]:
    lines = [
        f"{'held-out error [% of base torque]':<38}{'mean':>6}{'95 %':>15}{'median':>8}"
        f"{'worst joint':>13}"
    ]
    for r in found["models"]:
        low, high = r["ci95"]
        joint, worst = max(r["by_joint"].items(), key=lambda item: item[1])
        interval = f"[{low:.1f}, {high:.1f}]"
        lines.append(
            f"{r['name']:<38}{r['mean']:>6.1f}{interval:>15}{r['median']:>8.1f}"
            f"{f'{worst:.1f} (J{joint})':>13}"
        )
    floor = found["repeats"]
    lines.append(f"{'the thesis repeated':<38}{floor['mean']:>6.1f}{'':>15}{floor['median']:>8.1f}")
    for name, t in found["targets"].items():
        mark = "met" if t["met"] else "not met"
        lines.append(f"target {name}: {t['reached']:.1f} % of at most {t['target']:g} %: {mark}")
    return lines


def _show_tables(found: dict[str, Any]) -> list[str]:
    lines = [f"{'table':<8}{'cells':>6}{'mean difference':>17}{'median':>9}{'largest':>9}"]
    for number, s in found["tables"].items():
        lines.append(
            f"{number:<8}{s['cells']:>6.0f}{s['mean']:>15.1f} %{s['median']:>7.1f} %"
            f"{s['largest']:>7.1f} %"
        )
    return lines + [f"stuck: {text}" for text in found["stuck"]]


def _show_gte(found: dict[str, Any]) -> list[str]:
    ensemble = found["ensemble"]
    sums, changes = ensemble["sums"], ensemble["changes"]["both"]
    return [
        f"Table 4.11: signs of the dither's effect right {found['signs_right']} of "
        f"{found['axes']} ({found['always_falls']} if every error fell), of the rises "
        f"{found['rises_right']} of {found['rises']}; errors without dither off by a factor of "
        f"{found['factor']:.1f}",
        f"in an ensemble of {ensemble['set_ups']} set-ups, of {sums['cells']} cells within the "
        f"50 and 90 % intervals: {sums['in_50']} and {sums['in_90']} without dither, changes "
        f"{changes['in_50']} and {changes['in_90']}",
    ]


SHOWN: dict[str, Callable[[dict[str, Any]], list[str]]] = {
    "gap": _show_gap,
    "tables": _show_tables,
    "gte": _show_gte,
}
