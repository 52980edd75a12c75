"""``stiction reproduce``: the thesis simulated beside measured, and why the two differ."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction_envs.cli import common
from stiction_envs.cli.folder import OutputFolder, default_folder, provenance
from stiction_envs.cli.progress import Progress

if TYPE_CHECKING:
    from stiction_envs.experiments.sje.protocol import Job, Measurement

SEEDS = 5
"""Seeds of the optimiser: a parameter that some do not find again is not identified."""
PHASE_SECONDS = 1000.0
"""Simulated time of the iiwa's phases, roughly [s]: 64 ramps of about 15 s."""


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "reproduce",
        summary="Simulate the thesis's tables beside the measured ones; explain the difference.",
        example="stiction reproduce gap --out runs/gap",
        interrupted="what was done is kept; run the same command again to go on",
        run=run,
        show=show,
    )
    parser.add_argument(
        "targets",
        nargs="*",
        metavar="TARGET",
        type=_target,
        help="; ".join(f"{name}: {text}" for name, (_, text, _) in TARGETS.items())
        + " (default: all)",
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
        out="output folder, with one folder per target (default: runs/reproduce-TARGETS); one "
        "that holds a part of the same run is continued",
    )


def _target(name: str) -> str:
    if name not in TARGETS:
        raise argparse.ArgumentTypeError(f"{name!r}: available is {', '.join(TARGETS)}")
    return name


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run the targets; write a folder for each, and provenance."""
    # in our order, each once: the same run, however it was asked for
    args.targets = [t for t in TARGETS if t in args.targets] or list(TARGETS)
    if "gap" in args.targets:
        from stiction_envs.thesis.fit import optimiser

        optimiser()  # before anything is written
    name = "all" if len(args.targets) == len(TARGETS) else "-".join(args.targets)
    folder = OutputFolder(
        args.out or default_folder("reproduce", name),
        provenance(args, _inputs(args.targets)),
        force=args.force,
        resumable=True,
    )
    results: dict[str, Any] = {}
    with common.working(), folder:
        for target in args.targets:
            function, _, _ = TARGETS[target]
            (folder.path / target).mkdir(exist_ok=True)
            results[target] = function(args, folder.path / target)
    return {
        "command": "reproduce",
        "seed": args.seed,
        "out": str(folder.path),
        "targets": results,
    }


def _inputs(targets: list[str]) -> dict[str, Path]:
    """Return the files the targets depend on: arms, their friction, settings, measured tables."""
    import stiction_envs
    from stiction_envs.friction.parameters import friction_path
    from stiction_envs.measured import thesis_robots
    from stiction_envs.robots import ARMS

    package = Path(stiction_envs.__file__).parent
    found: dict[str, Path] = {}
    for robot in thesis_robots():
        found[robot] = ARMS[robot].model
        found[f"{robot}_table"] = ARMS[robot].toml
        found[f"{robot}_friction"] = friction_path(robot)
    found["protocol"] = package / "experiments" / "sje" / "sje.toml"
    if "gte" in targets:
        found["gte_protocol"] = package / "experiments" / "gte" / "gte.toml"
        found["controller"] = package / "control" / "gte.toml"
    if "gap" in targets:
        found["dither_fit"] = package / "thesis" / "dither_fit.toml"
    tables = {t: path for target in targets for t, path in _tables(package, target).items()}
    return {**found, **tables}


def _tables(package: Path, target: str) -> dict[str, Path]:
    names = [number.replace(".", "_") for number in TARGETS[target][2]]
    folder = package / "measured" / "thesis"
    return {f"table_{name}": folder / f"table_{name}.csv" for name in names}


# ---- targets: a function of (arguments, folder) that returns a plain summary ---------------------


def _gap(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Fit the nested models, or go on with them; write their page."""
    from stiction_envs.thesis.nested_models import NestedModels
    from stiction_envs.thesis.nyquist_phase import study_phase
    from stiction_envs.thesis.page import write_page

    seeds = range(args.seed, args.seed + args.seeds)
    nested = NestedModels(folder, seeds=seeds, processes=args.threads)
    with Progress("steps") as progress:
        for _ in nested.fit(progress.set):
            pass
    with Progress() as progress:
        study = study_phase(
            nthread=args.threads, progress=lambda s: progress.add("iiwa's phase", s, PHASE_SECONDS)
        )
    with Progress("figures") as progress:
        return write_page(folder, nested.models, study=study, progress=progress.set)


def _simulated_tables(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Simulate Tables 4.3 and 4.5 to 4.10 with the shipped friction."""
    from dataclasses import asdict

    from stiction_envs import __version__
    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from stiction_envs.robots import load_arm
    from stiction_envs.thesis.tables import TUNED, reproduce
    from stiction_envs.thesis.tables_page import write_tables
    from tuning.labbook import LabBook
    from tuning.rules import final_amplitude

    def measure(robot: str, jobs: list[Job]) -> dict[Job, Measurement]:
        experiment = SingleJointExperiment.of(
            robot, scatter=not args.no_scatter, seed=args.seed, nthread=args.threads
        )
        # the folder's provenance has told this run from others already
        book = LabBook(folder / f"{robot}.jsonl", {"robot": robot, "version": __version__})
        missing = [j for j in jobs if book.get("tables", j) is None]
        total = common.expected_seconds(experiment, missing, args.iterations)
        with Progress() as progress:
            return book.measure(
                "tables",
                experiment,
                jobs,
                iterations=args.iterations,
                progress=lambda seconds: progress.add(robot, seconds, total),
            )

    rates = load_arm(TUNED).limits.torque_rate
    found = reproduce(measure, rule=final_amplitude, torque_rate=rates)
    with Progress("figures") as progress:
        scores = write_tables(folder, found, progress=progress.set)
    stuck = [r for r in found.rows if r.simulated_nm != r.simulated_nm]
    return {
        "tables": scores,
        "chosen": [asdict(c) for c in found.chosen],
        "stuck": [
            f"{r.robot} table {r.table} joint {r.joint} {r.load} ({r.direction}) at "
            f"{r.frequency_hz:g} Hz"
            for r in stuck
        ],
    }


def _simulated_gte(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Simulate Table 4.11 and the figures of the Generated Trajectory Experiment."""
    from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
    from stiction_envs.thesis.gte import ROBOT, run_thesis_cases, thesis_cases, write_gte

    bench = GeneratedTrajectoryExperiment.of(
        ROBOT, scatter=not args.no_scatter, seed=args.seed, nthread=args.threads
    )
    repeats = args.iterations or bench.protocol.iterations
    seconds = [
        bench.nominal_duration(bench.path(c.trajectory)) + bench.protocol.tail
        for c in thesis_cases()
    ]
    with Progress() as progress:
        pairs = run_thesis_cases(
            bench,
            iterations=args.iterations,
            progress=lambda s: progress.add("gte", s, repeats * sum(seconds)),
        )
    with Progress("figures") as progress:
        return dict(write_gte(folder, pairs, progress=progress.set))


# ---- the list ------------------------------------------------------------------------------------

Target = tuple[Callable[[argparse.Namespace, Path], dict[str, Any]], str, tuple[str, ...]]
TARGETS: dict[str, Target] = {
    "gap": (
        _gap,
        "one physical statement after the other, fitted to Tables 4.3 and 4.6 and scored on the "
        "others, with a page that names each joint's causes",
        ("4.3", "4.5", "4.6", "4.7", "4.8", "4.9", "4.10"),
    ),
    "tables": (
        _simulated_tables,
        "Tables 4.3 and 4.5-4.10 and Appendices B-D with the shipped friction",
        ("4.3", "4.5", "4.6", "4.7", "4.8", "4.9", "4.10"),
    ),
    "gte": (
        _simulated_gte,
        "Table 4.11 and Figures 4.6-4.8, E.1, F.1 and F.2 with the shipped friction",
        ("4.9", "4.11"),
    ),
}
"""By name: function, help, and the thesis tables it depends on."""


def show(result: dict[str, Any]) -> str:
    """Return the results as readable tables."""
    lines: list[str] = []
    for target, found in result["targets"].items():
        lines += SHOWN[target](found)
        lines.append("")
    return "\n".join([*lines, f"written to {result['out']}"])


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
    return [
        f"Table 4.11: signs of the dither's effect right {found['signs_right']} of "
        f"{found['axes']}, of the rises {found['rises_right']} of {found['rises']}; errors without "
        f"dither off by a factor of {found['factor']:.1f}"
    ]


SHOWN: dict[str, Callable[[dict[str, Any]], list[str]]] = {
    "gap": _show_gap,
    "tables": _show_tables,
    "gte": _show_gte,
}
