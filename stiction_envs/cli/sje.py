"""``stiction sje``: the Single Joint Experiment, with and without dither."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction_envs.cli import common
from stiction_envs.cli.folder import OutputFolder, default_folder, provenance
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError

if TYPE_CHECKING:
    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from stiction_envs.experiments.sje.protocol import Job, Measurement
    from stiction_envs.measured import AmplitudeRow
    from stiction_envs.robots import Arm

LOADS, DIRECTIONS = ("load", "no_load"), ("+", "-")


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "sje",
        summary="Measure the torque at which joints break away, with and without dither.",
        example="stiction sje panda --joint 7 --dither final.csv --out runs/joint7",
        interrupted="nothing was written; run the same command again",
        run=run,
        show=show,
    )
    common.add_robot_options(parser)
    parser.add_argument(
        "--joint", nargs="+", type=common.whole(1), metavar="N", help="joints from 1 (default: all)"
    )
    parser.add_argument(
        "--load", nargs="+", choices=LOADS, default=list(LOADS), help="poses (default: both)"
    )
    parser.add_argument(
        "--direction", nargs="+", choices=DIRECTIONS, default=list(DIRECTIONS), help="default: both"
    )
    parser.add_argument(
        "--dither",
        type=Path,
        metavar="TABLE.csv",
        help="amplitude table, joint,frequency_hz,amplitude_nm[,waveform,offset_nm]: measure with "
        "it too, the joint under test dithered by its row",
    )
    common.add_experiment_options(parser)
    parser.add_argument(
        "--ramp-rate",
        type=common.number(0, above=True),
        metavar="NM_S",
        help="growth of the commanded torque [N·m/s]",
    )
    parser.add_argument(
        "--controller-rate",
        type=common.number(0, above=True),
        metavar="HZ",
        help="rate at which the controller computes, held in between (default: the robot's)",
    )
    parser.add_argument(
        "--lowpass",
        type=common.number(0),
        metavar="HZ",
        help="cut-off of the low-pass on commanded torque, 0 is off (default: the robot's)",
    )
    parser.add_argument(
        "--slots",
        type=common.whole(1),
        default=384,
        metavar="N",
        help="most simulations at once (default: %(default)s)",
    )
    common.add_shared_options(parser, out="output folder (default: runs/sje-ROBOT)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run the experiment; write ``sje.csv``, plots and provenance.

    A configuration with a stuck iteration has no torque: it is left out of ``sje.csv``, named in
    the result's ``stuck`` and ``failed``, and the exit code is 1. The others are written.
    """
    arm = common.read_arm(args)
    joints = common.check_joints(arm, args.joint)
    friction = common.read_friction(arm, args.friction)
    experiment_options = _interface_and_protocol(arm, args)
    table = _read_dither(arm, args, joints, experiment_options["interface"].controller_rate_hz)
    inputs = common.input_files(arm, args, dither=args.dither)
    folder = OutputFolder(
        args.out or default_folder("sje", arm.name), provenance(args, inputs), force=args.force
    )

    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from stiction_envs.experiments.sje.rows import in_order, is_stuck

    experiment = SingleJointExperiment.of(
        arm,
        friction=friction,
        scatter=not args.no_scatter,
        seed=args.seed,
        nthread=args.threads,
        **experiment_options,
    )
    jobs = _jobs(experiment, args, joints, table)
    total = common.expected_seconds(experiment, jobs, args.iterations)
    with common.working(), Progress() as progress:
        measured = in_order(
            experiment.run(
                jobs,
                iterations=args.iterations,
                progress=lambda seconds: progress.add("sje", seconds, total),
                slots=args.slots,
            )
        )
    stuck = [m for m in measured if is_stuck(m)]
    if len(stuck) == len(measured):
        raise common.Failed(f"{_stuck_text(stuck)}: nothing was written")
    with common.working(), folder:
        _write(folder.path, experiment, measured)
    return _result(experiment, measured, stuck, folder.path, args)


def _interface_and_protocol(arm: Arm, args: argparse.Namespace) -> dict[str, Any]:
    from stiction_envs.control.torque_path import TorqueInterface
    from stiction_envs.experiments.sje.protocol import load_protocol

    protocol = load_protocol(arm.name)
    if args.ramp_rate is not None:
        protocol = protocol.replace(ramp_rate=args.ramp_rate)
    interface = TorqueInterface.of(
        arm, controller_rate_hz=args.controller_rate, lowpass_hz=args.lowpass
    )
    return {"protocol": protocol, "interface": interface}


def _read_dither(
    arm: Arm, args: argparse.Namespace, joints: list[int], rate_hz: float
) -> dict[int, AmplitudeRow]:
    """Return the row of each joint that is dithered and tested."""
    if args.dither is None:
        return {}
    from stiction_envs.measured import read_amplitudes

    rows = read_amplitudes(
        args.dither,
        n_joints=arm.n,
        torque_limit=arm.limits.torque,
        controller_rate_hz=rate_hz,
    )
    for row in rows:
        if row.amplitude_nm == 0 and row.offset_nm != 0:
            raise StictionError(
                f"{args.dither}: joint {row.joint} has offset_nm {row.offset_nm:g} without "
                "amplitude: allowed is an amplitude_nm above 0, or no offset"
            )
    dithered = {row.joint: row for row in rows if row.amplitude_nm > 0}
    chosen = {j: row for j, row in dithered.items() if j in joints}
    if not chosen:
        has = ", ".join(map(str, sorted(dithered))) or "no joint"
        asked = ", ".join(map(str, joints))
        raise StictionError(f"{args.dither}: dithers {has}, but the joints tested are {asked}")
    return chosen


def _jobs(
    experiment: SingleJointExperiment,
    args: argparse.Namespace,
    joints: list[int],
    table: dict[int, AmplitudeRow],
) -> list[Job]:
    from stiction_envs.experiments.sje.protocol import Job

    base = [
        job
        for job in experiment.jobs(joints)
        if job.configuration.load in args.load and job.configuration.direction in args.direction
    ]
    dithered = []
    for job in base:
        row = table.get(job.configuration.joint)
        if row is not None:
            dithered.append(
                Job(
                    job.configuration,
                    frequency_hz=row.frequency_hz,
                    amplitude_nm=row.amplitude_nm,
                    waveform=row.waveform,
                    offset_nm=row.offset_nm,
                )
            )
    return base + dithered


def _write(path: Path, experiment: SingleJointExperiment, measured: list[Measurement]) -> None:
    from stiction_envs.experiments.sje.plots import plot_sje
    from stiction_envs.experiments.sje.rows import is_base, sje_rows
    from stiction_envs.measured import write_sje

    robot, protocol = experiment.sticking.arm.name, experiment.protocol
    write_sje(path / "sje.csv", sje_rows(measured, robot))
    groups: dict[str, list[Measurement]] = {}
    for m in measured:
        c = m.job.configuration
        ending = "" if is_base(m) else "_dither"
        groups.setdefault(f"joint{c.joint}_{c.load}{ending}.png", []).append(m)
    with Progress("plots") as progress:
        for k, (name, group) in enumerate(groups.items()):
            plot_sje(
                group,
                path / name,
                robot=robot,
                threshold=protocol.threshold,
                ramp_rate=protocol.ramp_rate,
            )
            progress.set("plots", k + 1, len(groups))


def _stuck_text(stuck: list[Measurement]) -> str:
    import numpy as np

    from stiction_envs.experiments.sje.plots import dither_text

    names = [
        f"joint {m.job.configuration.joint} {m.job.configuration.load} "
        f"({m.job.configuration.direction}) with {dither_text(m.job)}, "
        f"{int(np.isnan(m.tau).sum())} of {len(m.tau)} iterations"
        for m in stuck
    ]
    return f"stuck before the threshold was reached: {'; '.join(names)}"


def _result(
    experiment: SingleJointExperiment,
    measured: list[Measurement],
    stuck: list[Measurement],
    path: Path,
    args: argparse.Namespace,
) -> dict[str, Any]:
    from stiction_envs.experiments.sje.rows import is_stuck, sje_rows

    robot = experiment.sticking.arm.name
    rows = sje_rows(measured, robot)
    good = [m for m in measured if not is_stuck(m)]
    failed = f"{_stuck_text(stuck)}: left out of {path / 'sje.csv'}" if stuck else None
    return {
        "command": "sje",
        "robot": robot,
        "seed": args.seed,
        "out": str(path),
        "rows": [
            {**asdict(row), "iterations_tau_nm": m.tau} for row, m in zip(rows, good, strict=True)
        ],
        "stuck": [asdict(m.job.configuration) for m in stuck],
        "failed": failed,
    }


def show(result: dict[str, Any]) -> str:
    """Return the result as a readable table."""
    base = {_key(r): r for r in result["rows"] if not r["amplitude_nm"]}
    dithered = {_key(r): r for r in result["rows"] if r["amplitude_nm"]}
    lines = [f"{'configuration':<22}{'base τ_b [N·m]':>20}"]
    if dithered:
        lines[0] += f"{'dither':>20}{'τ_SJE [N·m]':>20}{'change':>10}"
    for key in dict.fromkeys([*base, *dithered]):
        joint, load, direction = key
        name = f"Joint {joint} {'Load' if load == 'load' else 'No load'} ({direction})"
        line = f"{name:<22}{_torque(base.get(key)):>20}"
        if dithered:
            row = dithered.get(key)
            if row is None:
                line += f"{'-':>20}"
            else:
                drive = f"{row['frequency_hz']:g} Hz, {row['amplitude_nm']:.3f} N·m"
                line += f"{drive:>20}{_torque(row):>20}"
                change = -100 * row["reduction"]
                line += f"{change:>+8.1f} %" if change == change else f"{'-':>10}"
        lines.append(line.rstrip())
    return "\n".join([*lines, f"written to {result['out']}"])


def _key(row: dict[str, Any]) -> tuple[int, str, str]:
    return row["joint"], row["load"], row["direction"]


def _torque(row: dict[str, Any] | None) -> str:
    if row is None:
        return "stuck"
    spread = "" if row["iterations"] == 1 else f" ± {row['std_nm']:.4f}"
    return f"{row['tau_nm']:+.4f}{spread}"
