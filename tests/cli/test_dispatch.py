"""Progress, and the last resort of the error handling."""

import argparse
import contextlib
import io
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from stiction_envs.cli import common, sje
from stiction_envs.cli import progress as progress_module
from stiction_envs.cli.progress import Progress, interruptible


def test_identity_does_not_depend_on_where_and_how_fast():
    def found(**changes: object) -> str:
        values = {"command": "sje", "seed": 0, "joint": [7], "out": "a", "threads": 0, **changes}
        return common.run_provenance(argparse.Namespace(**values), {})["arguments_sha256"]

    assert found(out="b", threads=4, force=True) == found()
    assert found(joint=[6]) != found()
    assert found(seed=1) != found()


def test_progress_off_a_terminal_is_a_line_now_and_then(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr(progress_module.time, "monotonic", lambda: clock[0])
    with Progress() as progress:
        for _ in range(100):
            clock[0] += 1.0
            progress.add("sje", 1.0, 80.0)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 100 // progress_module.EVERY
    assert lines[0] == "sje: 12 % (10 of 80 s simulated)"
    assert lines[-1] == "sje: 100 % (80 of 80 s simulated)"


def test_progress_on_a_terminal_is_a_bar(monkeypatch):
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", terminal)
    with Progress() as progress:
        progress.set("base", 1.0, 4.0)
        progress.set("final", 2.0, 4.0)
    text = terminal.getvalue()
    assert "base:" in text
    assert "final:" in text
    assert "|" in text


def test_progress_of_the_whole_off_a_terminal_is_a_line_per_stage(capsys):
    with Progress() as progress:
        for stage, share in (("reading", 0.0), ("reading", 0.04), ("columns", 0.05)):
            progress.whole(stage, share)
        progress.whole("report", 0.876)
        progress.whole("simulating", None)
    assert capsys.readouterr().err.splitlines() == [
        "  0 % reading",
        "  5 % columns",
        " 88 % report",
        "simulating",
    ]


@pytest.fixture
def failing(cli, monkeypatch):
    """Run `stiction sje panda`, which raises an error from a cause."""

    def run(error: BaseException, cause: BaseException | None = None):
        def fail(args):
            raise error from cause

        monkeypatch.setattr(sje.common, "read_arm", fail)
        return cli("sje", "panda")

    return run


def test_unexpected_error_is_one_line(failing, monkeypatch):
    ran = failing(RuntimeError("two\nlines"))
    assert ran.code == 1
    assert ran.lines == ["error: RuntimeError: two lines (STICTION_DEBUG=1 shows the traceback)"]
    monkeypatch.setenv("STICTION_DEBUG", "1")
    assert "Traceback" in failing(RuntimeError("two\nlines")).err


def test_interrupt_says_how_to_go_on(failing):
    """Also one that compiled code passes on."""
    wrapped = SystemError("returned a result with an exception set")
    for error in ((KeyboardInterrupt(),), (wrapped, KeyboardInterrupt())):
        ran = failing(*error)
        assert ran.code == 1
        assert ran.lines == ["error: interrupted: nothing was written; run the same command again"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_standard_output_on_a_full_disk(tmp_path, monkeypatch):
    """With a buffer: output left in the buffer raises the error again when Python ends."""
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    code = "import sys; from stiction_envs.cli import main; sys.exit(main(sys.argv[1:]))"
    table = tmp_path / "final.csv"
    table.write_text("joint,frequency_hz,amplitude_nm\n7,15,0.1\n")
    argv = [sys.executable, "-c", code, "check", table]
    with open("/dev/full", "w") as full:
        ran = subprocess.run(argv, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ran.returncode == 1
    assert ran.stderr == "error: standard output: no space left on device\n"


@pytest.fixture
def default_interrupt() -> Iterator[None]:
    """Python's own handler of Ctrl-C, whatever a library of an earlier test left."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("default_interrupt")
def test_an_interruption_that_python_loses_still_ends_the_work() -> None:
    """Python ignores exceptions in a finalizer or a callback of a weak reference."""
    with interruptible():
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            Progress().set("work", 1, 2)
        with pytest.raises(KeyboardInterrupt):
            Progress().whole("work", 0.5)
    Progress().set("later work", 1, 2)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
