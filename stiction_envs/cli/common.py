"""Shared parts of the commands: parser, options, input files, errors."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from stiction_envs.errors import ExperimentError, StictionError

if TYPE_CHECKING:
    from stiction_envs.reporting.output_folder import OutputFolder
    from stiction_envs.reporting.provenance import Provenance
    from stiction_envs.robots import Arm

_NEGATIVE = re.compile(r"^-(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$|^-(inf|nan)$", re.IGNORECASE)
IDEAL = "ideal"
"""Default of the option ``--sensing``."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Output of a command, which the dispatcher prints as text or as JSON."""

    result: Any = None
    """Result, which prints itself as text and has ``to_json()``."""
    out: Path | None = None
    """Folder or file of the result."""
    files: str = ""
    """Names of files in the folder that a person wants to see."""
    more: Mapping[str, object] = field(default_factory=dict)
    """JSON values besides the result's; ``failed`` among them is the reason for exit code 1."""
    text: str = ""
    """Text for people in place of the result and the folder."""

    def to_json(self) -> dict[str, object]:
        """Return the values of ``--json``; those of ``more`` override the result's."""
        place = {} if self.out is None else {"out": str(self.out)}
        values = {} if self.result is None else self.result.to_json()
        return {**place, **self.more, **values, **self.more}

    def __str__(self) -> str:
        files = f": {self.files}" if self.files else ""
        return self.text or f"{self.result}\nwritten to {self.out}{files}"


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
    """Turn errors into `ExperimentError`: the input was good, so work has failed."""
    try:
        yield
    except StictionError as error:
        raise ExperimentError(str(error)) from error


# ---- types of options ----------------------------------------------------------------------------


def number(
    low: float = -math.inf, *, above: bool = False, kind: type[float] = float
) -> Callable[[str], float]:
    """Return the type of finite (of ``kind`` int: whole) numbers from ``low``, or above it."""
    expected = "whole numbers" if kind is int else "finite numbers"
    if math.isfinite(low):
        expected += f" above {low:g}" if above else f" from {low:g}"

    def convert(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or value < low or (above and value == low):
            raise argparse.ArgumentTypeError(f"{text!r}: expected {expected}")
        return value

    return convert


whole = partial(number, kind=int)
"""Return the type of whole numbers from a lowest one."""


# ---- options -------------------------------------------------------------------------------------


_KINDS: dict[str, Callable[[str], object]] = {
    **dict.fromkeys(("N", "K", "P"), whole(1)),
    **dict.fromkeys(("HZ", "KP"), number(0, above=True)),
    **dict.fromkeys(("KD", "KT", "M", "NM"), number(0)),
    **dict.fromkeys(("MASS", "Q", "ROLL", "X"), number()),
    **dict.fromkeys(("DIR", "FILE", "FILE.csv", "FILE.toml", "LOG", "TABLE.csv"), Path),
}
"""What a value is, by its name in the usage; else a text."""


def option(
    parser: argparse._ActionsContainer,
    usage: str,
    help_text: str,
    kind: Callable[[str], object] | None = None,
    **more: Any,
) -> None:
    """Add an option or argument by its usage, such as ``--tool X Y Z`` or ``--joints NAME ...``.

    The usage starts with the name; without values it is a flag. ``kind`` is what the values are,
    if it is not that of `_KINDS`; ``more`` is argparse's.
    """
    name, *values = usage.split()
    if values[-1:] == ["..."]:
        values.pop()
        more["nargs"] = "+"
    elif len(values) > 1:
        more["nargs"] = len(values)
    if values:
        more["metavar"] = values[0] if len(values) == 1 else tuple(values)
        more["type"] = kind or _KINDS.get(values[0], str)
    elif name.startswith("--") and "choices" not in more:
        more["action"] = "store_true"
    parser.add_argument(name, help=help_text, **more)


def robot_help() -> str:
    """Return the help of an argument that names a robot."""
    from stiction_envs.robots.registry import ARMS

    return (
        f"{', '.join(ARMS)}, or a path to an MJCF or URDF (.xml, .mjcf, .urdf) or to a folder of "
        "MuJoCo Menagerie, or a name in robot_descriptions' cache (ur5e_mj_description)"
    )


def add_chain_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--chain``."""
    option(
        parser,
        "--chain BASE TIP",
        "select one serial arm of a bigger robot by its first and last link; all other "
        "joints are locked in the robot's rest pose",
    )


SERVO_DRIVE = (
    "drive of the joints: torque, with gravity compensated; or position, by the servos of "
    "--friction (a model.toml of servo logs), with dither as a sine on the commanded angle "
    "(default: position if the file has [servo], else torque)"
)


def add_drive_option(parser: argparse.ArgumentParser, what: str) -> None:
    """Add the option that says what drives the joints; ``what`` is its help."""
    option(parser, "--drive", what, choices=("torque", "position"))


def add_mounting_options(parser: Parser) -> None:
    """Add the options on payload, tilt and mounting."""
    option(
        parser,
        "--payload MASS X Y Z",
        "mass on the flange [kg] and its centre of mass in the flange frame [m]",
    )
    option(
        parser,
        "--tilt ROLL PITCH",
        "inclination of the base: about the world's x, then its y [rad]",
    )


def add_robot_options(parser: Parser, *, friction: bool = True) -> None:
    """Add the arm to simulate, and its known payload and tilt."""
    option(parser, "robot ROBOT", robot_help())
    add_chain_option(parser)
    add_mounting_options(parser)
    parser.set_defaults(tilt=[0.0, 0.0])
    if friction:
        option(
            parser,
            "--friction FILE.toml",
            "joint friction, written by `stiction calibrate` (default: the robot's)",
        )


def add_sensing_option(parser: Parser) -> None:
    """Add the option that says what the controller sees."""
    option(
        parser,
        "--sensing ideal|robot|FILE.toml",
        "signals of the controller: the true state without delay, or with sensor noise and "
        "delays of the robot, or of a TOML with a table [sensing] (default: %(default)s)",
        default=IDEAL,
    )


def add_experiment_options(parser: Parser) -> None:
    """Add the options of an experiment's repeats."""
    option(
        parser,
        "--iterations K",
        "repeats per configuration (default: the robot's in the thesis)",
    )
    option(
        parser,
        "--no-scatter",
        "no scatter of pose, friction and torque reading: all iterations are equal",
    )


def add_shared_options(parser: Parser, *, out: str, metavar: str = "DIR") -> None:
    """Add the options of all commands that write files; ``out`` is the help of ``--out``."""
    option(parser, f"--out {metavar}", out, Path)
    option(parser, "--force", "replace the files of another run in --out")
    add_json_and_seed(parser)
    option(parser, "--threads N", "threads (0: all processors)", whole(0), default=0)


def add_json_and_seed(parser: Parser) -> None:
    """Add the options of every command."""
    option(parser, "--json", "print the result as JSON; progress is on stderr")
    option(parser, "--seed S", "seed of all random numbers", whole(0), default=0)


# ---- input ---------------------------------------------------------------------------------------

NOT_RECORDED = {
    *("command", "run", "interrupted"),  # the program's own
    "seed",  # is recorded by itself
    # no result depends on them
    *("out", "force", "json", "threads"),
}


def read_arm(args: argparse.Namespace) -> Arm:
    """Load the arm of `add_robot_options`."""
    from stiction_envs.robots import load_arm

    return load_arm(args.robot, payload=args.payload, tilt=args.tilt, chain=args.chain)


def note_robot(args: argparse.Namespace) -> None:
    """Say on standard error how a user's robot file was read; its errors are the command's."""
    from stiction_envs.robots import ARMS, load_arm
    from stiction_envs.robots.stated import SPRINGS, WITHOUT_FRICTION

    robot = getattr(args, "robot", None)
    if robot is None or str(robot) in ARMS:
        return
    nominal = getattr(args, "nominal", None)
    used: bool | tuple[str, ...] = nominal in (None, "file")
    if args.command in ("check", "excite", "identify"):
        used = WITHOUT_FRICTION
    elif getattr(args, "friction", None) is not None:  # rotors are in it, too
        used = (SPRINGS,)
    with suppress(StictionError):
        arm = load_arm(robot, chain=getattr(args, "chain", None))
        for note in arm.notes(used):
            print(f"note: {note}", file=sys.stderr)


def arm_name(args: argparse.Namespace) -> str:
    """Return the name of the arm in the names of output folders."""
    from stiction_envs.robots.chain import chain_title

    return str(args.robot) if args.chain is None else chain_title(Path(args.robot).stem, args.chain)


def output_folder(
    args: argparse.Namespace,
    name: str | Path,
    inputs: Mapping[str, Path | None] | None = None,
    *,
    resumable: bool = False,
) -> OutputFolder:
    """Check the output folder before any work; nothing is written yet.

    Args:
        args: of the command.
        name: part of the default folder's name.
        inputs: files by the name of their argument, without those that are None or missing; not
            needed where the result has its own provenance.
        resumable: whether the same run may be continued in its folder.
    """
    from stiction_envs.reporting.output_folder import OutputFolder, default_folder

    return OutputFolder(
        args.out or default_folder(args.command, name),
        run_provenance(args, inputs or {}),
        force=args.force,
        resumable=resumable,
    )


def run_provenance(args: argparse.Namespace, inputs: Mapping[str, Path | None]) -> Provenance:
    """Return the provenance of a command line's result."""
    from stiction_envs.measured.logs.log_files import is_log
    from stiction_envs.reporting.provenance import provenance

    recorded = {k: v for k, v in vars(args).items() if k not in NOT_RECORDED}
    return provenance(
        args.command,
        recorded,
        seed=args.seed,
        inputs={k: v for k, v in inputs.items() if v is not None and is_log(v)},
    )


def model_files(args: argparse.Namespace, arm: Arm) -> dict[str, Path | None]:
    """Return the files of an arm, its friction, senses and compensation, and names of no file."""
    from stiction_envs.friction.sticking import friction_file
    from stiction_envs.robots.registry import robot_files

    given = {name: getattr(args, name, None) for name in ("sensing", "compensation")}
    return {
        **robot_files(args.robot),
        "friction": friction_file(arm, getattr(args, "friction", None)),
        **{name: Path(text) for name, text in given.items() if text is not None},
    }
