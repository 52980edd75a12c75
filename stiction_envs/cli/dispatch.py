"""From arguments to an exit code: the only place that prints errors and knows the codes."""

import argparse
import os
import sys
import traceback
import warnings
from collections.abc import Iterable, Sequence
from importlib.metadata import entry_points
from typing import Protocol

from stiction_envs.cli import (
    calibrate,
    check,
    conformance,
    diagnose,
    excite,
    export,
    gte,
    identify,
    sje,
    view,
)
from stiction_envs.cli.common import Answer, Parser, note_robot
from stiction_envs.cli.progress import interruptible
from stiction_envs.errors import ExperimentError, StictionError, one_line
from stiction_envs.reporting.atomic import naming
from stiction_envs.reporting.json_text import to_text
from stiction_envs.version import __version__

DONE, FAILED, BAD_INPUT = 0, 1, 2


class Command(Protocol):
    """Interface of a command's module, which has the command's name or a ``NAME``.

    An ``INTERRUPTED`` says what Ctrl-C leaves, and how to go on.
    """

    __name__: str
    SUMMARY: str
    EXAMPLE: str

    def add_options(self, parser: Parser) -> None:
        """Add the command's options."""

    def run(self, args: argparse.Namespace) -> Answer:
        """Do the work; return what is printed."""


COMMANDS: tuple[Command, ...] = (
    *(sje, gte, calibrate, excite, identify),
    *(check, diagnose, export, view, conformance),
)
GROUP = "stiction_envs.commands"
"""Entry points of other packages' modules of that kind."""


def all_commands() -> list[Command]:
    """Return the modules of all commands: ours, then those of installed packages."""
    return [*COMMANDS, *(point.load() for point in entry_points(group=GROUP))]


def build_parser(commands: Iterable[Command]) -> Parser:
    """Return the parser of these commands."""
    parser = Parser(
        prog="stiction",
        description="Robot joints that stick in MuJoCo, and the dither that frees them.",
        epilog="Exit codes: 0 done, 1 failed while working, 2 bad input (nothing written).",
    )
    parser.add_argument("--version", action="version", version=f"stiction-envs {__version__}")
    subparsers = parser.add_subparsers(
        dest="command", metavar="COMMAND", required=True, parser_class=Parser
    )
    for module in commands:
        own = subparsers.add_parser(
            getattr(module, "NAME", module.__name__.rpartition(".")[2]),
            help=module.SUMMARY,
            description=module.SUMMARY,
            epilog=f"example:\n  {module.EXAMPLE}",
        )
        interrupted = getattr(module, "INTERRUPTED", "run the same command again")
        own.set_defaults(interrupted=interrupted, run=module.run)
        module.add_options(own)
    return parser


def main(argv: Sequence[str] | None = None, commands: Iterable[Command] | None = None) -> int:
    """Run one command, by default of `all_commands`; return the exit code.

    It is 0 done, 1 failed while working, 2 bad input or usage. One line on standard error says why;
    the environment variable STICTION_DEBUG=1 adds the traceback.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal that does not know "·"
    interrupted = "nothing was written"
    try:
        args = build_parser(all_commands() if commands is None else commands).parse_args(argv)
        interrupted = args.interrupted
        with interruptible(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = _show_warning
            answer: Answer = args.run(args)
            note_robot(args)  # bad input is one line by itself
        values = {"command": args.command, **answer.to_json()}
        text = to_text(values) if args.json else str(answer)
        with naming("standard output"):  # a file on a full disk, it may be
            _print(text)
        if failed := answer.more.get("failed"):
            return _say(failed, FAILED)
        return DONE
    except SystemExit as end:  # --help
        return end.code if isinstance(end.code, int) else BAD_INPUT
    except ExperimentError as error:
        return _say(error, FAILED)
    except StictionError as error:
        return _say(error, BAD_INPUT)
    except KeyboardInterrupt:
        return _say(f"interrupted: {interrupted}", FAILED)
    except BrokenPipeError:  # the reader of our output has gone
        _discard_output()
        return FAILED
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _say(f"{where}{(error.strerror or str(error)).lower()}", FAILED)
    except Exception as error:
        if isinstance(error.__cause__, KeyboardInterrupt):  # numba's way to pass it on
            return _say(f"interrupted: {interrupted}", FAILED)
        name = type(error).__name__
        return _say(f"{name}: {error} (STICTION_DEBUG=1 shows the traceback)", FAILED)


def _print(text: str) -> None:
    """Print and flush; what cannot be written is discarded before the error goes on."""
    try:
        print(text, flush=True)
    except OSError:
        _discard_output()
        raise


def _discard_output() -> None:
    """Send standard output nowhere: Python would complain again of what is left at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _say(message: object, code: int) -> int:
    if os.environ.get("STICTION_DEBUG") == "1":
        traceback.print_exc()
    print(f"error: {one_line(message)}", file=sys.stderr)
    return code


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {one_line(message)}", file=sys.stderr)
