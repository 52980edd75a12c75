"""``stiction excite``: a motion to run on a robot so that its dynamics can be identified."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from stiction_envs.cli import common
from stiction_envs.cli.folder import OutputFolder, default_folder, provenance
from stiction_envs.cli.progress import Progress

if TYPE_CHECKING:
    from stiction_envs.identification.settings import ExcitationSettings

OPTIONS = ("base_frequency", "harmonics", "periods", "clearance")


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = common.add_command(
        subparsers,
        "excite",
        summary="Find a motion inside all limits that excites an arm's dynamics well.",
        example="stiction excite panda --sweeps --out runs/excite-panda",
        interrupted="run the same command again",
        run=run,
        show=show,
    )
    common.add_robot_options(parser, friction=False)
    parser.add_argument(
        "--base-frequency",
        type=common.number(0, above=True),
        metavar="HZ",
        help="of the Fourier series; a period is its inverse (default: 0.1)",
    )
    parser.add_argument(
        "--harmonics", type=common.whole(2), metavar="N", help="of the series (default: 5)"
    )
    parser.add_argument(
        "--periods", type=common.whole(1), metavar="P", help="of the series (default: 2)"
    )
    parser.add_argument(
        "--clearance",
        type=common.number(0),
        metavar="M",
        help="least distance to the floor at z = 0 and between links [m] (default: 0.05)",
    )
    parser.add_argument(
        "--sweeps", action="store_true", help="add slow sweeps there and back, for friction"
    )
    parser.add_argument(
        "--rate",
        type=common.number(0, above=True),
        metavar="HZ",
        help="samples per second of trajectory.csv (default: the robot's controller rate)",
    )
    common.add_shared_options(parser, out="output folder (default: runs/excite-ROBOT)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Search; write ``trajectory.csv``, ``excitation.json``, a plot and provenance."""
    arm = common.read_arm(args)
    settings = _settings(args)
    robot = common.robot_file(arm, args.robot)
    inputs = {"robot": robot, "robot_table": robot.with_suffix(".toml")}
    found = provenance(args, {k: v for k, v in inputs.items() if v.is_file()})
    folder = OutputFolder(args.out or default_folder("excite", arm.name), found, force=args.force)

    from stiction_envs.identification.excitation import excite
    from stiction_envs.identification.excitation_plots import plot_excitation
    from stiction_envs.measured import write_text_atomic

    with common.working(), Progress("per cent") as progress:
        motion = excite(
            arm,
            settings,
            sweeps=args.sweeps,
            seed=args.seed,
            progress=lambda stage, part: progress.set(stage, 100 * part, 100),
        )
        with folder:
            motion.to_csv(folder.path / "trajectory.csv", args.rate or arm.controller_rate_hz)
            answer = common.plain(motion.to_json())
            text = json.dumps(answer, indent=2, ensure_ascii=False, allow_nan=False)
            write_text_atomic(folder.path / "excitation.json", text + "\n")
            plot_excitation(motion, arm, folder.path / "excitation.png")
    return {"command": "excite", "out": str(folder.path), **answer}


def _settings(args: argparse.Namespace) -> ExcitationSettings:
    from stiction_envs.identification.settings import identification_settings

    given = {k: getattr(args, k) for k in OPTIONS if getattr(args, k) is not None}
    return identification_settings().excitation.replace(**given)


def show(result: dict[str, Any]) -> str:
    """Return the result as readable lines."""
    random = result["random_condition"]
    used = ", ".join(f"{k} {100 * v:.0f} %" for k, v in result["used"].items())
    return "\n".join(
        [
            f"{result['duration_s']:.4g} s, from rest to rest",
            f"condition number {result['condition']:.3g} (random motions inside the same limits: "
            f"{random['median']:.3g} in the median, {random['least']:.3g} at best)",
            f"of what the margins leave of each limit: {used}",
            f"clearance {result['clearance_m']:.3g} m",
            *result["notes"],
            f"written to {result['out']}: trajectory.csv",
        ]
    )
