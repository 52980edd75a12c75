"""``stiction calibrate``: joint friction from measured base torques."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from stiction_envs.cli import common
from stiction_envs.cli.folder import check_place, provenance
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "calibrate",
        summary="Identify an arm's joint friction from its measured base torques.",
        example="stiction calibrate panda base.csv --out my_panda.toml",
        interrupted="nothing was written; run the same command again",
        run=run,
        show=show,
    )
    common.add_robot_options(parser)
    parser.add_argument(
        "table",
        type=Path,
        metavar="TABLE.csv",
        help="base torques: an SJE table (base.csv) or the form of thesis Table 4.3",
    )
    common.add_shared_options(
        parser,
        out="friction TOML, provenance inside (default: runs/calibrate-ROBOT/friction.toml)",
        metavar="FILE.toml",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Calibrate and write the friction TOML."""
    arm = common.read_arm(args)
    from stiction_envs.measured import read_base

    # a file of one's own arm may call it differently
    table = read_base(args.table, arm.name if arm.registered else None, arm.n)
    friction = common.read_friction(arm, args.friction)
    out = args.out or Path("runs") / f"calibrate-{arm.name}" / "friction.toml"
    _check_file(out, force=args.force)

    from stiction_envs.experiments.settings import experiment_settings
    from stiction_envs.experiments.sje.calibrate import calibrate, calibrated_toml
    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from stiction_envs.measured import write_text_atomic

    experiment = SingleJointExperiment.of(
        arm, friction=friction, scatter=False, seed=args.seed, nthread=args.threads
    )
    with common.working():
        with Progress("rounds") as progress:
            rounds = experiment_settings().calibration.rounds
            progress.set("calibrate", 0, rounds)
            result = calibrate(
                table,
                experiment,
                progress=lambda k, error: progress.set("calibrate", k, rounds),
            )
        found = provenance(args, common.input_files(arm, args, table=args.table))
        base = common.friction_file(arm, args.friction)
        text = calibrated_toml(result, str(base), args.table.name, args.table.read_bytes())
        out.parent.mkdir(parents=True, exist_ok=True)
        write_text_atomic(out, _with_provenance(text, found))
    return {
        "command": "calibrate",
        "robot": arm.name,
        "out": str(out),
        "rounds": result.rounds,
        "largest_relative_error": result.error,
        "negative_load_coefficient": list(result.negative_load),
        "rows": [
            {
                "joint": j + 1,
                "load": ("load", "no_load")[k],
                "direction": "+-"[d],
                "measured_nm": table.tau[j, k, d],
                "simulated_nm": result.simulated[j, k, d],
            }
            for j in range(arm.n)
            for k in range(2)
            for d in range(2)
        ],
    }


def _check_file(out: Path, *, force: bool) -> None:
    if out.suffix != ".toml":
        raise StictionError(f"--out {out}: allowed is a path to a .toml")
    if out.is_dir():
        raise StictionError(f"--out {out}: is a folder: allowed is a path to a .toml")
    if out.exists() and not force:
        raise StictionError(f"--out {out}: exists: choose another name, or --force")
    check_place(out)


def _with_provenance(text: str, found: dict[str, Any]) -> str:
    """Return the TOML with the run's provenance in its [provenance] table."""
    commit = found["git_commit"] or "none: not run from a checkout"
    entries = {
        "arguments_sha256": found["arguments_sha256"],
        "git_commit": commit,
        "seed": str(found["seed"]),
        "friction_sha256": found["inputs"]["friction"]["sha256"],
        "robot_sha256": found["inputs"]["robot"]["sha256"],
        "versions": ", ".join(f"{k} {v}" for k, v in found["versions"].items()),
    }
    lines = "".join(f'{k} = "{v}"\n' for k, v in entries.items())
    return text.replace("[provenance]\n", f"[provenance]\n{lines}", 1)


def show(result: dict[str, Any]) -> str:
    """Return the result as a readable table."""
    lines = [f"{'configuration':<22}{'measured [N·m]':>16}{'simulated [N·m]':>17}{'off':>9}"]
    for r in result["rows"]:
        pose = "Load" if r["load"] == "load" else "No load"
        name = f"Joint {r['joint']} {pose} ({r['direction']})"
        off = 100 * (r["simulated_nm"] / r["measured_nm"] - 1)
        lines.append(
            f"{name:<22}{r['measured_nm']:>+16.4f}{r['simulated_nm']:>+17.4f}{off:>+7.2f} %"
        )
    if result["negative_load_coefficient"]:
        joints = ", ".join(map(str, result["negative_load_coefficient"]))
        lines.append(
            f"joints {joints}: friction was smaller in the load pose, which load does not explain"
        )
    return "\n".join([*lines, f"{result['rounds']} rounds, written to {result['out']}"])
