"""What the commands share: parser, options, input files, errors."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from stiction_envs.errors import StictionError

if TYPE_CHECKING:
    from stiction_envs.experiments.sje.experiment import SingleJointExperiment
    from stiction_envs.friction.parameters import FrictionParameters
    from stiction_envs.robots import Arm

_NEGATIVE = re.compile(r"^-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$|^-(inf|nan)$", re.IGNORECASE)


class Failed(RuntimeError):
    """Something went wrong while working: exit code 1, the message is one line."""


class Parser(argparse.ArgumentParser):
    """`ArgumentParser` whose usage errors are one line, as all others."""

    def __init__(self, **options: Any) -> None:
        options.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(allow_abbrev=False, **options)
        # so that -1e-3 and -inf are numbers and not options
        self._negative_number_matcher = _NEGATIVE

    def error(self, message: str) -> NoReturn:
        """Raise the usage error."""
        raise StictionError(f"{message} (see {self.prog} --help)")


@contextmanager
def working() -> Iterator[None]:
    """Past this point the input was good: an error is a failure while working."""
    try:
        yield
    except StictionError as error:
        raise Failed(str(error)) from error


def one_line(text: str) -> str:
    """Return the text with every run of white space, line ends too, as one blank."""
    return " ".join(text.split())


def plain(value: Any) -> Any:
    """Return JSON values: paths as text, numbers as Python's, what is not finite as None."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


# ---- types of options ----------------------------------------------------------------------------


def whole(low: int) -> Callable[[str], int]:
    """Return the type of whole numbers from ``low``."""

    def convert(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if value < low:
            raise argparse.ArgumentTypeError(f"{text!r}: allowed are whole numbers from {low}")
        return value

    return convert


def number(low: float = -math.inf, *, above: bool = False) -> Callable[[str], float]:
    """Return the type of finite numbers from ``low``, or above it."""
    allowed = "finite numbers"
    if math.isfinite(low):
        allowed += f" above {low:g}" if above else f" from {low:g}"

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or value < low or (above and value == low):
            raise argparse.ArgumentTypeError(f"{text!r}: allowed are {allowed}")
        return value

    return convert


# ---- options -------------------------------------------------------------------------------------


def add_command(
    subparsers: Any, name: str, *, summary: str, example: str, interrupted: str, **functions: Any
) -> Parser:
    """Add a command's parser.

    Args:
        subparsers: of the main parser.
        name: the command.
        summary: one sentence.
        example: a call that works.
        interrupted: what Ctrl-C leaves, and how to go on.
        functions: ``run`` and ``show`` of the command.
    """
    parser: Parser = subparsers.add_parser(
        name, help=summary, description=summary, epilog=f"example:\n  {example}"
    )
    parser.set_defaults(interrupted=interrupted, **functions)
    return parser


def robot_help() -> str:
    """Return which robots there are."""
    from stiction_envs.robots.registry import ARMS

    return f"{', '.join(ARMS)}, or a path to an MJCF or URDF (.xml, .mjcf, .urdf)"


def add_log_options(parser: argparse.ArgumentParser, *, logs: str) -> None:
    """Add the joint logs, the robot they are of and how to read them; ``logs`` is nargs."""
    parser.add_argument(
        "logs",
        nargs=logs,
        type=Path,
        metavar="LOG",
        help="t,q1..qn[,dq1..dqn],tau1..taun as .csv, .csv.gz, .npz or .parquet; one robot",
    )
    parser.add_argument("--robot", required=True, metavar="ROBOT", help=robot_help())
    parser.add_argument(
        "--torque",
        choices=("motor", "link"),
        default="motor",
        help="side of the gear on which tau was measured (Franka, KUKA: link; default: motor)",
    )
    parser.add_argument(
        "--cutoff",
        type=number(0, above=True),
        metavar="HZ",
        help="of the zero-phase filter of all signals (default: chosen from the data)",
    )


def add_robot_options(parser: Parser, *, friction: bool = True) -> None:
    """Add what says which arm is simulated."""
    parser.add_argument("robot", metavar="ROBOT", help=robot_help())
    parser.add_argument(
        "--payload",
        nargs=4,
        type=number(),
        metavar=("MASS", "X", "Y", "Z"),
        help="mass on the flange [kg] and its centre of mass in the flange frame [m]",
    )
    parser.add_argument(
        "--tilt",
        nargs=2,
        type=number(),
        metavar=("ROLL", "PITCH"),
        default=[0.0, 0.0],
        help="inclination of the base: about the world's x, then its y [rad]",
    )
    if friction:
        parser.add_argument(
            "--friction",
            type=Path,
            metavar="FILE.toml",
            help="joint friction, as `stiction calibrate` writes it (default: the robot's)",
        )


def add_experiment_options(parser: Parser) -> None:
    """Add what says how the experiment is run."""
    parser.add_argument(
        "--iterations",
        type=whole(1),
        metavar="K",
        help="repeats per configuration (default: the robot's in the thesis)",
    )
    parser.add_argument(
        "--no-scatter",
        action="store_true",
        help="make all iterations alike: no scatter of pose, friction and torque reading",
    )


def add_shared_options(parser: Parser, *, out: str, metavar: str = "DIR") -> None:
    """Add what every command has; ``out`` is the help of ``--out``."""
    parser.add_argument("--out", type=Path, metavar=metavar, help=out)
    parser.add_argument(
        "--force", action="store_true", help="replace the files of another run in --out"
    )
    parser.add_argument(
        "--json", action="store_true", help="print the result as JSON; progress is on stderr"
    )
    parser.add_argument(
        "--seed", type=whole(0), default=0, metavar="S", help="seed of all that is random"
    )
    parser.add_argument(
        "--threads", type=whole(0), default=0, metavar="N", help="threads (0: all processors)"
    )


# ---- input ---------------------------------------------------------------------------------------


def read_arm(args: argparse.Namespace) -> Arm:
    """Load the arm of `add_robot_options`."""
    from stiction_envs.robots import load_arm

    return load_arm(args.robot, payload=args.payload, tilt=args.tilt)


def friction_file(arm: Arm, given: Path | None) -> Path:
    """Return the friction TOML that counts: the one given, the arm's, or the generic one."""
    from stiction_envs.friction.parameters import friction_path

    if given is None:
        return friction_path(arm.name if arm.registered else "generic")
    if given.suffix != ".toml":
        raise StictionError(f"friction file {given}: allowed is a path to a .toml")
    return given


def read_friction(arm: Arm, given: Path | None) -> FrictionParameters:
    """Load the friction of an arm from its own or the given TOML."""
    from stiction_envs.friction.parameters import load_friction

    return load_friction(friction_file(arm, given), arm.n)


def robot_file(arm: Arm, given: str) -> Path:
    """Return the file that describes the arm."""
    from stiction_envs.robots.registry import ARMS

    return ARMS[arm.name].model if arm.registered else Path(given).expanduser()


def input_files(arm: Arm, args: argparse.Namespace, **others: Path | None) -> dict[str, Path]:
    """Return the files a run depends on, by the name of their argument."""
    robot = robot_file(arm, args.robot)
    found = {
        "robot": robot,
        "robot_table": robot.with_suffix(".toml"),
        "friction": friction_file(arm, getattr(args, "friction", None)),
        **{k: v for k, v in others.items() if v is not None},
    }
    return {k: v for k, v in found.items() if v.is_file()}


def check_joints(arm: Arm, joints: list[int] | None) -> list[int]:
    """Return the joints asked for, sorted, all by default.

    Raises:
        StictionError: a joint the arm does not have.
    """
    from stiction_envs.experiments.sje.protocol import configurations

    return sorted({c.joint for c in configurations(arm.n, joints)})


def expected_seconds(
    experiment: SingleJointExperiment, jobs: list[Any], iterations: int | None
) -> float:
    """Return the simulated time [s] a run will take, roughly, for the progress bar."""
    p = experiment.protocol
    approach = p.return_time + p.settle_time
    ramps = sum(approach + experiment.expected(job) / p.ramp_rate for job in jobs)
    return float(ramps * (p.iterations if iterations is None else iterations))
