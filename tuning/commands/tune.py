"""``stiction tune``: the dither that frees an arm, by the thesis's protocol or by search."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError
from stiction_envs.reporting.output_folder import default_folder
from tuning.names import OBJECTIVES, SAMPLERS, TREATMENTS

if TYPE_CHECKING:
    from stiction_envs.robots import Arm

THESIS_ONLY = ("frequencies", "scales", "table", "iterations", "no_scatter", "drive")
SEARCH_ONLY = (
    *("sampler", "objective", "pareto", "bounds", "evaluations", "limit", "beside"),
    *("treatment", "ask", "tell"),
)
WITH_A_ROBOT = ("ask", "tell", "bounds", "limit")
"""Options of the search that tuning on a real robot has too."""


SUMMARY = "Find frequency and amplitude of the dither of every joint, and verify them."
EXAMPLE = "stiction tune panda --protocol thesis --table base.csv --out runs/tune-panda"
INTERRUPTED = "what was measured is kept; run the same command again to go on"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    common.add_robot_options(parser)
    common.add_drive_option(parser, common.SERVO_DRIVE)
    common.add_sensing_option(parser)
    common.option(
        parser,
        "--protocol",
        "thesis: frequencies, then scales, then verification (thesis 4.2; default); search: "
        "continuous amplitude and frequency of every joint, under constraints",
        choices=("thesis", "search"),
        default="thesis",
    )
    common.option(
        parser,
        "--table TABLE.csv",
        "measured base torques, in the form of base.csv or thesis Table 4.3; the friction is "
        "first calibrated to these torques",
    )
    common.option(
        parser,
        "--frequencies HZ ...",
        "frequencies to try (default: the thesis's for this robot)",
    )
    common.option(
        parser,
        "--scales X ...",
        "amplitudes to try, relative to the base torque (default: 0.8 1.0 1.2)",
        common.number(0, above=True),
    )
    _add_search_options(parser)
    common.add_experiment_options(parser)
    common.option(
        parser,
        "--storage URL",
        "database of the study: sqlite:///FILE, or postgresql+psycopg://USER:PASSWORD@HOST/DB "
        "to share the study between machines (default: a file in --out)",
    )
    common.option(parser, "--study NAME", "name of the Optuna study")
    common.add_shared_options(
        parser,
        out="output folder (default: runs/tune-ROBOT); an unfinished run of the same command is "
        "continued",
    )


def _add_search_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("with --protocol search")
    common.option(
        group,
        "--objective",
        "minimise the breakaway torque of each joint (sje, default), the error left at the "
        "goals of a path (gte), or both (gte starts from the table of sje)",
        choices=OBJECTIVES,
    )
    common.option(
        group, "--sampler", "default: gp for the SJE, cmaes for the GTE", choices=SAMPLERS
    )
    common.option(
        group,
        "--evaluations N",
        "number of trials: per joint (SJE), of whole tables (GTE)",
    )
    common.option(
        group, "--pareto", "make shaking a second objective instead of a constraint (pareto.csv)"
    )
    common.option(
        group,
        "--treatment",
        "search only this treatment of friction, on paths: dither, a compensation, both "
        "observers, or all one after the other with the same budget; the report says which is best "
        "on other paths and what it needs to know",
        choices=TREATMENTS,
    )
    common.option(
        group,
        "--bounds FILE.toml",
        "[all], [joint.N]: amplitude_nm, frequency_hz, forbidden_hz, displacement_rad; [arm]: "
        "vibration_mm, vibration_at_rest_mm",
    )
    common.option(
        group,
        "--limit TABLE.csv",
        "limit the oscillation to that of this amplitude table (default: thesis Table 4.9 on "
        "a Panda)",
    )
    common.option(
        group,
        "--beside TABLE.csv ...",
        "amplitude tables to compare with, simulated in the same plant",
    )
    common.option(
        group,
        "--ask N",
        "with a real robot: write the next N settings per joint to measure (ask.csv; "
        "default: 1; --out: runs/ask-ROBOT)",
        nargs="?",
        const=1,
    )
    common.option(
        group,
        "--tell TABLE.csv",
        "read measurements (a filled-in measure.csv, or any SJE table); can be combined with --ask",
    )


def run(args: argparse.Namespace) -> common.Answer:
    """Tune; write tables, report, plots and provenance."""
    _check_options(args)
    arm = common.read_arm(args)
    asks = args.ask is not None or args.tell is not None
    args.out = args.out or default_folder("ask" if asks else "tune", arm.name)
    way = _with_a_robot if asks else _search if args.protocol == "search" else _thesis
    with Progress() as progress:
        return way(args, arm, progress)


def _check_options(args: argparse.Namespace) -> None:
    other = THESIS_ONLY if args.protocol == "search" else SEARCH_ONLY
    for name in other:
        if getattr(args, name) not in (None, False):
            raise StictionError(f"--{name.replace('_', '-')}: not with --protocol {args.protocol}")
    if args.ask is not None or args.tell is not None:
        for name in (*SEARCH_ONLY, "storage", "study", "force"):
            if name not in WITH_A_ROBOT and getattr(args, name) not in (None, False):
                raise StictionError(f"--{name.replace('_', '-')}: not with --ask or --tell")
        if args.sensing != common.IDEAL:
            raise StictionError("--sensing: not with --ask or --tell")


def _given(args: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Return the options that the user gave, and those that every way of tuning has."""
    names = (*names, "seed", "friction", "threads", "out")
    return {name: value for name in names if (value := getattr(args, name)) is not None}


def _thesis(args: argparse.Namespace, arm: Arm, progress: Progress) -> common.Answer:
    from tuning.protocol.tune import tune

    names = ("table", "frequencies", "scales", "iterations", "sensing", "drive")
    result = tune(
        arm,
        scatter=not args.no_scatter,
        progress=progress.set,
        **_given(args, *names, "storage", "study", "force"),
    )
    return common.Answer(result=result, out=args.out)


def _search(args: argparse.Namespace, arm: Arm, progress: Progress) -> common.Answer:
    from tuning.search.search import search

    def say(stage: str, done: float, total: float) -> None:
        progress.set(stage, done, total, "s simulated" if stage == "base torques" else "trials")

    names = [x for x in SEARCH_ONLY if x not in ("ask", "tell")]
    given = _given(args, *names, "sensing", "storage", "study", "force")
    return common.Answer(result=search(arm, progress=say, **given), out=args.out)


def _with_a_robot(args: argparse.Namespace, arm: Arm, progress: Progress) -> common.Answer:
    from tuning.robot.session import Session

    more = {}
    options = {"progress": progress.set, **_given(args, "bounds", "limit")}
    if args.tell is not None:
        state = Session(arm, **options).tell(args.tell)
        more = {"told": state.told}
    if args.ask is not None:
        state = Session(arm, **options).ask(args.ask)
    return common.Answer(result=state, out=args.out, more=more)
