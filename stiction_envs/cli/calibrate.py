"""``stiction calibrate``: joint friction from measured base torques."""

import argparse

from stiction_envs.cli import common
from stiction_envs.cli.progress import Progress

SUMMARY = "Identify an arm's joint friction from its measured base torques."
EXAMPLE = "stiction calibrate panda base.csv --out my_panda.toml"
INTERRUPTED = "nothing was written; run the same command again"


def add_options(parser: common.Parser) -> None:
    """Add the options."""
    common.add_robot_options(parser)
    common.option(
        parser,
        "table TABLE.csv",
        "base torques: an SJE table (base.csv) or the form of thesis Table 4.3",
    )
    common.add_shared_options(
        parser,
        out="friction TOML, provenance inside (default: runs/calibrate-ROBOT/friction.toml)",
        metavar="FILE.toml",
    )


def run(args: argparse.Namespace) -> common.Answer:
    """Calibrate and write the friction TOML."""
    arm = common.read_arm(args)

    from stiction_envs.experiments.sje.calibrate import ROUNDS, calibrate
    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from stiction_envs.friction.sticking import friction_origin
    from stiction_envs.measured.tables import read_base
    from stiction_envs.reporting.output_folder import check_file, default_folder

    # a file of one's own arm may call it differently
    table = read_base(args.table, arm.registered_name, arm.n)
    files = common.model_files(args, arm)
    experiment = SingleJointExperiment(
        arm,
        friction=args.friction,
        drive="torque",
        scatter=False,
        seed=args.seed,
        threads=args.threads,
    )
    out = args.out or default_folder("calibrate", arm.name) / "friction.toml"
    check_file(out, ".toml", force=args.force)
    with common.working():
        with Progress("rounds") as progress:
            progress.set("calibrate", 0, ROUNDS)
            result = calibrate(
                table,
                experiment,
                progress=lambda k, error: progress.set("calibrate", k, ROUNDS),
            )
        result.write_toml(
            out,
            base=friction_origin(arm, args.friction),
            table=args.table.name,
            content=args.table.read_bytes(),
            run=common.run_provenance(args, {**files, "table": args.table}),
        )
    text = f"{result}, written to {out}"
    return common.Answer(result=result, out=out, more={"robot": arm.name}, text=text)
