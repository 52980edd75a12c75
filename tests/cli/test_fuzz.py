"""Every command fed damaged files and random options: one line, nothing written, never a traceback.

``STICTION_FUZZ=2000 pytest tests/cli/test_fuzz.py`` looks longer. What is good after all begins to
work, and is interrupted: a command that does not stop then hangs.
"""

import argparse
import contextlib
import importlib
import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stiction_envs.cli import main
from stiction_envs.cli.dispatch import BAD_INPUT, all_commands, build_parser
from stiction_envs.robots import load_arm
from tests.command_line import Ran
from tests.gap.small_logs import dry, hidden, write_csv
from tests.robots.arms import TWO, URDF

pytestmark = pytest.mark.slow
EXAMPLES = int(os.environ.get("STICTION_FUZZ", "5"))
PATIENCE = 1.5
"""Seconds after which work is interrupted."""
START = 6.0
"""Seconds more for a process that has to load everything."""
APART = ("train", "tune")
"""Commands that load torch piecemeal: an interruption leaves it half loaded for all that follow."""
BOUND = 30.0
"""Seconds in which a command has stopped then, on a busy machine."""
FUZZ = settings(
    max_examples=EXAMPLES,
    deadline=None,
    derandomize="STICTION_FUZZ" not in os.environ,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
ARM = ("--robot", "two.xml")
QUICK = ("--joint", "1", "--iterations", "1")
TRIANGLE = ("--trajectory", "triangle", "--stiffness", "200", "20", "0", "--iterations", "1")
TRAIN = ("two.xml", "sje", "--algo", "ppo", "--steps", "4096")
READERS = (
    # the damaged file, and a command that reads it
    ("two.xml", ("sje", "two.xml", *QUICK)),
    ("two.urdf", ("sje", "two.urdf", *QUICK)),
    ("friction.toml", ("sje", "two.xml", "--friction", "friction.toml", *QUICK)),
    ("table.csv", ("sje", "two.xml", "--dither", "table.csv", *QUICK)),
    ("path.csv", ("gte", "panda", *TRIANGLE[2:], "--trajectory", "path.csv")),
    ("gains.csv", ("gte", "two.xml", *TRIANGLE, "--compensation", "push")),
    ("base.csv", ("calibrate", "two.xml", "base.csv")),
    ("base.csv", ("diagnose", "base.csv", *ARM)),
    ("bounds.toml", ("tune", "two.xml", "--protocol", "search", "--bounds", "bounds.toml")),
    ("log.csv", ("diagnose", "log.csv", *ARM)),
    ("model.toml", ("diagnose", "whole.csv", *ARM, "--nominal", "model.toml")),
    ("settings.toml", ("train", *TRAIN, "--settings", "settings.toml")),
)
LIBRARIES = ("optuna", "pinocchio", "sklearn", "torch._dynamo", "stable_baselines3")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of good files, each read by a command of `READERS`."""
    # a library that is interrupted while it loads may abort the process
    for library in LIBRARIES:
        with contextlib.suppress(ImportError):
            importlib.import_module(library)
    out = tmp_path_factory.mktemp("good")
    (out / "two.xml").write_text(TWO)
    (out / "two.urdf").write_text(URDF)
    (out / "table.csv").write_text("joint,frequency_hz,amplitude_nm\n1,15,0.6\n2,30,0.2\n")
    (out / "path.csv").write_text("x,y,z\n0.05,0,0\n0.05,0.05,0\n0,0,0\n")
    (out / "gains.csv").write_text("joint,gain_nm\n1,0.2\n2,0.1\n")
    (out / "bounds.toml").write_text(
        "[all]\nfrequency_hz = [15.0, 80.0]\n[joint.1]\namplitude_nm = [0, 1]\n"
    )
    (out / "settings.toml").write_text("[ppo]\narguments.n_steps = 16\n")
    write_csv(out / "log.csv", hidden(load_arm(out / "two.xml"), dry, seconds=8.0))
    shutil.copy(out / "log.csv", out / "whole.csv")
    with contextlib.chdir(out):
        for argv in (
            ("sje", "two.xml", "--iterations", "1", "--out", "sje"),
            ("calibrate", "two.xml", "base.csv", "--out", "friction.toml"),
            ("diagnose", "log.csv", *ARM, "--out", "why"),
        ):
            if argv[0] == "calibrate":
                shutil.copy("sje/sje.csv", "base.csv")
            assert main(list(argv)) == 0
        shutil.copy("why/model.toml", "model.toml")
    return out


def run(argv: list[str]) -> Ran | None:
    """Run a command line; None when it was still at work after `PATIENCE`, and interrupted."""
    if argv[0] in APART:
        return run_apart(argv)
    out, err = io.StringIO(), io.StringIO()
    at_work = False

    def interrupt(*_: object) -> None:
        nonlocal at_work
        at_work = True
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    start = time.monotonic()
    # again and again: an interruption in a destructor or a callback is lost
    signal.setitimer(signal.ITIMER_REAL, PATIENCE, 1.0)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(argv)
    except KeyboardInterrupt:  # between the end of the command and ours
        code = 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert time.monotonic() - start < BOUND, f"hangs: {argv}"
    # what a library makes of an interruption in its midst is not looked at
    return None if at_work else Ran(code, out.getvalue(), err.getvalue())


def run_apart(argv: list[str]) -> Ran | None:
    """Run a command line in a process of its own, as `run` does."""
    code = "import sys; from stiction_envs.cli import main; sys.exit(main(sys.argv[1:]))"
    if any("\0" in word for word in argv):  # no shell can say that
        return None
    interrupt = ["timeout", "-s", "INT", "-k", str(BOUND), str(START + PATIENCE)]
    done = subprocess.run(
        [*interrupt, sys.executable, "-c", code, *argv],
        capture_output=True,
        text=True,
        check=False,
        # a process of the background would not hear of Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert done.returncode not in (137, -9), f"hangs: {argv}"
    return None if done.returncode == 124 else Ran(done.returncode, done.stdout, done.stderr)


@contextlib.contextmanager
def folder(good: Path) -> Iterator[Path]:
    """Enter a folder with the good files in it."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        for path in good.iterdir():
            if path.is_file():
                shutil.copy(path, place / path.name)
        with contextlib.chdir(place):
            yield place


def check(ran: Ran | None, before: set[Path], place: Path, argv: list[str]) -> None:
    if ran is None:
        return
    assert ran.code in (0, 1, BAD_INPUT), (argv, ran)
    assert "STICTION_DEBUG" not in ran.err, (argv, ran.err)
    assert "Traceback" not in ran.err, (argv, ran.err)
    if ran.code:
        errors = [line for line in ran.lines if line.startswith("error: ")]
        assert len(errors) == 1, (argv, ran.err)
        assert ran.lines[-1] == errors[0], (argv, ran.err)
    if ran.code == BAD_INPUT:
        assert set(place.rglob("*")) == before, (argv, ran.err)


@st.composite
def damages(draw: st.DrawFn, content: bytes) -> bytes:
    """Return a file's bytes, cut off, overwritten, with another word in them, or other ones."""
    kind = draw(st.sampled_from(["cut", "flip", "word", "noise"]))
    if kind == "cut":
        return content[: draw(st.integers(0, len(content) - 1))]
    if kind == "flip":
        out = bytearray(content)
        for _ in range(draw(st.integers(1, 8))):
            out[draw(st.integers(0, len(out) - 1))] = draw(st.integers(0, 255))
        return bytes(out)
    if kind == "word":
        words = [
            *("nan", "inf", "-1", "1e308", "0", "", "x", "9" * 400, "{", "[]", "\u0301", '"', "\n")
        ]
        text = content.decode("utf-8", "replace")
        cells = [k for k, c in enumerate(text) if c in ",= \n"] or [0]
        k = draw(st.sampled_from(cells))
        return (text[: k + 1] + draw(st.sampled_from(words)) + text[k + 1 :]).encode()
    return draw(st.binary(max_size=300))


@pytest.mark.parametrize(("name", "argv"), READERS, ids=lambda x: x if isinstance(x, str) else x[0])
@FUZZ
@given(data=st.data())
def test_damaged_files(good: Path, name: str, argv: tuple[str, ...], data: st.DataObject) -> None:
    with folder(good) as place:
        line = list(argv)
        if name == "gains.csv":
            line += ["--compensation-table", name]
        (place / name).write_bytes(data.draw(damages((good / name).read_bytes())))
        before = set(place.rglob("*"))
        line += ["--out", "new.toml" if argv[0] == "calibrate" else "new"]
        check(run(line), before, place, line)


def actions(command: str) -> list[argparse.Action]:
    parser = build_parser(all_commands())._subparsers._group_actions[0].choices[command]
    return [a for a in parser._actions if a.option_strings and a.dest != "help"]


WORDS = st.sampled_from(
    [
        *("", "0", "1", "-1", "7", "1e400", "nan", "inf", "1e-300", "9" * 20, "two.xml", "."),
        *("nowhere.csv", "log.csv", "/", "panda", "x" * 300, "a\x00b", "\u202e", "+", "load"),
        *("gp", "grid", "ppo", "sje", "gte", "sqlite:///x.db", "http://x", "triangle", "link", "-"),
    ]
)


@pytest.mark.parametrize("command", [m.__name__.rsplit(".", 1)[-1] for m in all_commands()])
@FUZZ
@given(data=st.data())
def test_random_options(good: Path, command: str, data: st.DataObject) -> None:
    with folder(good) as place:
        line = [command, *data.draw(st.lists(WORDS, max_size=3))]
        for action in data.draw(st.lists(st.sampled_from(actions(command)), max_size=4)):
            line.append(data.draw(st.sampled_from(action.option_strings)))
            line += data.draw(st.lists(WORDS, max_size=4))
        before = set(place.rglob("*"))
        check(run(line), before, place, line)
