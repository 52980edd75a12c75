"""``stiction gte``: the Generated Trajectory Experiment, with and without dither."""

from __future__ import annotations

import argparse
import dataclasses
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stiction_envs.cli import common
from stiction_envs.cli.folder import OutputFolder, default_folder, provenance
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError, unknown

if TYPE_CHECKING:
    from stiction_envs.control.trajectory import Path as Course
    from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
    from stiction_envs.experiments.gte.measures import Measures
    from stiction_envs.experiments.gte.protocol import Case, Run
    from stiction_envs.measured import AmplitudeRow
    from stiction_envs.robots import Arm

Measured = tuple["Run", "Measures"]
# as the packages have them; written out, so that --help does not load the engine
TRAJECTORIES = ("triangle", "pentagon")
PHASES = ("random", "zero", "spread")
DAMPING_DESIGNS = ("mass", "diagonal")
DITHER_OPTIONS = ("gate_velocity", "waveform", "phases")


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    from stiction_envs.dither.waveforms import WAVEFORMS

    parser = common.add_command(
        subparsers,
        "gte",
        summary="Follow a path under Cartesian impedance control, with and without dither.",
        example="stiction gte panda --trajectory triangle --stiffness 200 20 0 --dither final.csv",
        interrupted="nothing was written; run the same command again",
        run=run,
        show=show,
    )
    common.add_robot_options(parser)
    names = "|".join(TRAJECTORIES)
    parser.add_argument(
        "--trajectory",
        required=True,
        metavar=f"{names}|FILE.csv",
        help="path: by name, or goals relative to the start, x,y,z[,roll,pitch,yaw] or "
        "x,y,z,qw,qx,qy,qz [m, rad]",
    )
    parser.add_argument(
        "--stiffness",
        nargs=3,
        required=True,
        type=common.number(0),
        metavar=("KT", "KR", "KN"),
        help="translational [N/m], rotational [N·m/rad], nullspace [N·m/rad]",
    )
    parser.add_argument(
        "--dither",
        type=Path,
        metavar="TABLE.csv",
        help="amplitude table, joint,frequency_hz,amplitude_nm[,waveform,offset_nm]: run with it "
        "too, all its joints dithered at once",
    )
    parser.add_argument(
        "--gate-velocity",
        type=common.number(0, above=True),
        metavar="V",
        help="dither fades with joint speed, by exp(-(v/V)^2) [rad/s] (default: it does not)",
    )
    parser.add_argument(
        "--waveform", choices=tuple(WAVEFORMS), help="of every joint (default: the table's)"
    )
    parser.add_argument(
        "--phases",
        choices=PHASES,
        help="of the joints' dithers: drawn in every iteration, all 0, or spread over a period "
        "(default: random)",
    )
    parser.add_argument(
        "--damping-design",
        choices=DAMPING_DESIGNS,
        help="mass: thesis eq. 2.14; diagonal: 2 sqrt(K) (default: mass)",
    )
    parser.add_argument(
        "--compensate-payload",
        nargs=4,
        type=common.number(),
        metavar=("MASS", "X", "Y", "Z"),
        help="payload the controller believes in (default: the true one)",
    )
    parser.add_argument(
        "--compensate-tilt",
        nargs=2,
        type=common.number(),
        metavar=("ROLL", "PITCH"),
        help="inclination the controller believes in [rad] (default: the true one)",
    )
    common.add_experiment_options(parser)
    common.add_shared_options(parser, out="output folder (default: runs/gte-ROBOT)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run the experiment; write tables, plots and provenance."""
    arm = common.read_arm(args)
    belief = _read_belief(args)
    course = _read_course(args.trajectory)
    friction = common.read_friction(arm, args.friction)
    dither = _read_dither(arm, args)
    file = None if course is None else Path(args.trajectory)
    inputs = common.input_files(arm, args, dither=args.dither, trajectory=file)
    folder = OutputFolder(
        args.out or default_folder("gte", arm.name), provenance(args, inputs), force=args.force
    )

    from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
    from stiction_envs.experiments.gte.measures import measure

    bench = GeneratedTrajectoryExperiment.of(
        arm,
        friction=friction,
        settings=_settings(arm, args),
        paths={} if course is None else {course.name: course},
        belief=belief,
        scatter=not args.no_scatter,
        seed=args.seed,
        nthread=args.threads,
    )
    cases = _cases(args, course, dither)
    iterations = args.iterations or bench.protocol.iterations
    expected = bench.nominal_duration(bench.path(cases[0].trajectory)) + bench.protocol.tail
    total = expected * len(cases) * iterations
    with common.working(), Progress() as progress:
        runs = bench.run(
            cases,
            iterations=iterations,
            progress=lambda seconds: progress.add("gte", seconds, total),
        )
        measured = [(r, measure(r, bench.protocol, bench.motion)) for r in runs]
    from stiction_envs.measured import thesis_robots

    compared = course is None and arm.name in thesis_robots("4.11")
    with common.working(), folder:
        _write(folder.path, bench, measured, compared)
    return _result(bench, measured, compared, folder.path, args)


def _read_course(text: str) -> Course | None:
    """Return the path of a file; None for a path by name."""
    from stiction_envs.control.trajectory import read_path

    if text in TRAJECTORIES:
        return None
    if not text.lower().endswith(".csv"):
        raise unknown("trajectory", text, [*TRAJECTORIES, "a path to a .csv"])
    return read_path(text)


def _read_belief(args: argparse.Namespace) -> Arm | None:
    """Return the arm the controller believes in; None for the true one."""
    if args.compensate_payload is None and args.compensate_tilt is None:
        return None
    from stiction_envs.robots import load_arm

    payload, tilt = args.compensate_payload, args.compensate_tilt
    return load_arm(
        args.robot,
        payload=args.payload if payload is None else payload,
        tilt=args.tilt if tilt is None else tilt,
    )


def _read_dither(arm: Arm, args: argparse.Namespace) -> tuple[AmplitudeRow, ...]:
    """Return the rows of the dithered joints, of the waveform asked for."""
    if args.dither is None:
        for name in DITHER_OPTIONS:
            if getattr(args, name) is not None:
                raise StictionError(f"--{name.replace('_', '-')}: needs --dither TABLE.csv")
        return ()
    from stiction_envs.measured import read_amplitudes

    rows = read_amplitudes(
        args.dither,
        n_joints=arm.n,
        torque_limit=arm.limits.torque,
        controller_rate_hz=arm.controller_rate_hz,
    )
    if not any(row.amplitude_nm > 0 for row in rows):
        raise StictionError(f"{args.dither}: dithers no joint: allowed is an amplitude_nm above 0")
    if args.waveform is not None:
        rows = [dataclasses.replace(row, waveform=args.waveform) for row in rows]
    return tuple(rows)


def _settings(arm: Arm, args: argparse.Namespace) -> Any:
    if args.damping_design is None:
        return None
    from stiction_envs.control.settings import ImpedanceSettings

    return ImpedanceSettings(
        rate_hz=float(arm.controller_rate_hz), damping_design=args.damping_design
    )


def _cases(
    args: argparse.Namespace, course: Course | None, dither: tuple[AmplitudeRow, ...]
) -> list[Case]:
    """Return the case without dither, and the one with it if there is any."""
    from stiction_envs.experiments.gte.protocol import Case

    plain = Case(
        trajectory=args.trajectory if course is None else course.name,
        stiffness=tuple(args.stiffness),
    )
    if not dither:
        return [plain]
    chosen = {k: getattr(args, k) for k in ("gate_velocity", "phases")}
    options = {k: v for k, v in chosen.items() if v is not None}
    return [plain, dataclasses.replace(plain, dither=dither, **options)]


def _write(
    path: Path, bench: GeneratedTrajectoryExperiment, measured: list[Measured], compared: bool
) -> None:
    from stiction_envs.experiments.gte import plots as gte_plots
    from stiction_envs.experiments.gte import rows as gte_table

    robot, runs = bench.sticking.arm.name, [r for r, _ in measured]
    rows = [row for r, m in measured for row in gte_table.error_rows(r, m, robot)]
    gte_table.write_rows(path / "errors.csv", rows)
    gte_table.write_rows(path / "runs.csv", [gte_table.run_row(r, m, robot) for r, m in measured])
    gte_table.write_points(path / "points.csv", measured)
    gte_table.write_trace(path / "trace.csv", runs)
    gte_plots.plot_path_xy(runs, path / "path_xy.png", robot=robot)
    gte_plots.plot_path_3d(runs, path / "path_3d.png", robot=robot)
    gte_plots.plot_errors(runs, path / "error_position.png", robot=robot)
    gte_plots.plot_errors(runs, path / "error_orientation.png", robot=robot, orientation=True)
    if compared and len(runs) == 2 and gte_table.thesis_window_sums(runs[0].case):
        pairs = [(measured[0], measured[1])]
        gte_plots.plot_window_sums(pairs, path / "table_4_11.png", robot=robot)


def _result(
    bench: GeneratedTrajectoryExperiment,
    measured: list[Measured],
    compared: bool,
    path: Path,
    args: argparse.Namespace,
) -> dict[str, Any]:
    from stiction_envs.experiments.gte.rows import error_rows, run_row, thesis_window_sums

    robot = bench.sticking.arm.name
    rows = []
    for r, m in measured:
        thesis = (thesis_window_sums(r.case) if compared else None) or {}
        for row in error_rows(r, m, robot):
            rows.append({**asdict(row), "thesis_window_sum": thesis.get(row.axis)})
    runs = [asdict(run_row(r, m, robot)) for r, m in measured]
    unfinished = sum(r["unfinished"] for r in runs)
    return {
        "command": "gte",
        "robot": robot,
        "seed": args.seed,
        "out": str(path),
        "rows": rows,
        "runs": runs,
        "failed": f"{unfinished} iterations never reached their last goal: their numbers are NaN"
        if unfinished
        else None,
    }


def show(result: dict[str, Any]) -> str:
    """Return the result as a readable table."""
    by_case: dict[str, list[dict[str, Any]]] = {}
    for row in result["rows"]:
        by_case.setdefault(row["case"], []).append(row)
    plain, shaken = by_case["no_dither"], by_case.get("dither")
    printed = any(row["thesis_window_sum"] is not None for row in plain)
    head = f"{'sum of |error|':<20}{'no dither':>18}"
    head += f"{'dither':>18}{'change':>9}" if shaken else ""
    head += f"{'thesis: without':>18}" if printed else ""
    head += f"{'with':>9}" if printed and shaken else ""
    lines = [head]
    for k, row in enumerate(plain):
        line = f"{row['axis'] + ' [' + row['unit'] + '·samples]':<20}{_sum(row):>18}"
        if shaken:
            change = 100 * (shaken[k]["window_sum"] / row["window_sum"] - 1)
            line += f"{_sum(shaken[k]):>18}{change:>+7.1f} %"
        if printed:
            line += f"{row['thesis_window_sum']:>18.3f}"
            line += f"{shaken[k]['thesis_window_sum']:>9.3f}" if shaken else ""
        lines.append(line)
    for r in result["runs"]:
        text = f"{r['case'].replace('_', ' ')}: {r['duration_s']:.2f} s, "
        text += f"vibration {1e3 * r['vibration_m']:.3f} mm "
        text += f"({1e3 * r['vibration_at_rest_m']:.3f} mm at rest), "
        text += f"dither energy {r['dither_energy_j']:.2f} J, "
        text += f"torque rate up to {r['peak_torque_rate_nm_s']:.0f} N·m/s"
        if r["goals_missed"]:
            text += f", {r['goals_missed']} goals left beyond the tolerance"
        if r["singular"] or r["near_limit"]:
            text += f", iterations singular {r['singular']}, near a limit {r['near_limit']}"
        lines.append(text)
    return "\n".join([*lines, f"written to {result['out']}"])


def _sum(row: dict[str, Any]) -> str:
    spread = "" if row["iterations"] == 1 else f" ± {row['window_sum_std']:.3f}"
    return f"{row['window_sum']:.3f}{spread}"
