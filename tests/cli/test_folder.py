"""Output folders, progress and the last resort of the error handling."""

import argparse
import io
import json
import sys

import pytest

from stiction_envs.cli import folder as folder_module
from stiction_envs.cli import progress as progress_module
from stiction_envs.cli import sje
from stiction_envs.cli.common import plain
from stiction_envs.cli.folder import OutputFolder, git_commit, provenance
from stiction_envs.cli.progress import Progress
from stiction_envs.errors import StictionError


def found(**changes: object) -> dict:
    values = {"command": "sje", "seed": 0, "joint": [7], "out": "a", "threads": 0, **changes}
    return provenance(argparse.Namespace(**values), {})


def test_identity_depends_on_what_decides_a_result():
    mine = found()["arguments_sha256"]
    assert found(out="b", threads=4)["arguments_sha256"] == mine
    assert found(seed=1)["arguments_sha256"] != mine
    assert found(joint=[6])["arguments_sha256"] != mine
    assert found(command="tune")["arguments_sha256"] != mine


def test_identity_depends_on_the_content_of_inputs_and_not_on_their_place(tmp_path):
    args = argparse.Namespace(command="sje", seed=0, dither=tmp_path / "a.csv")
    hashes = []
    for name, text in (("a.csv", "1"), ("b.csv", "1"), ("a.csv", "2")):
        args.dither = tmp_path / name
        args.dither.write_text(text)
        hashes.append(provenance(args, {"dither": args.dither})["arguments_sha256"])
    assert hashes[0] == hashes[1]
    assert hashes[0] != hashes[2]


def test_failed_run_leaves_nothing_where_it_wrote_nothing(tmp_path):
    folder = OutputFolder(tmp_path / "a", found())
    assert not (tmp_path / "a").exists()
    with pytest.raises(ZeroDivisionError), folder:
        raise ZeroDivisionError
    assert not (tmp_path / "a").exists()


def test_unfinished_run_is_resumed_by_itself_only(tmp_path):
    def half() -> None:
        with OutputFolder(tmp_path, found(), resumable=True):
            (tmp_path / "half.csv").write_text("1")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half()
    assert OutputFolder(tmp_path, found(), resumable=True).resumed
    with pytest.raises(StictionError, match="a run of stiction sje"):
        OutputFolder(tmp_path, found())
    with pytest.raises(StictionError, match="--force"):
        OutputFolder(tmp_path, found(seed=1), resumable=True)
    assert not OutputFolder(tmp_path, found(seed=1), resumable=True, force=True).resumed


def test_force_deletes_only_what_a_run_has_listed(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "precious.txt").write_text("x")
    (out / "mine.txt").write_text("x")
    with OutputFolder(out, found(), force=True) as f:
        (f.path / "plots").mkdir()
        (f.path / "plots" / "a.png").write_text("x")
    text = json.loads((out / "provenance.json").read_text())
    assert text["files"] == ["plots/a.png"]
    text["files"].append("../precious.txt")
    (out / "provenance.json").write_text(json.dumps(text))
    with OutputFolder(out, found(), force=True):
        assert not (out / "plots").exists()
    assert (tmp_path / "precious.txt").exists()
    assert (out / "mine.txt").exists()


def test_commit_is_that_of_this_checkout_or_none(monkeypatch, tmp_path):
    commit = git_commit()
    assert commit is None or len(commit.removesuffix("-dirty")) == 40
    git_commit.cache_clear()
    # a package below somebody else's repository
    monkeypatch.setattr(
        folder_module.stiction_envs, "__file__", str(tmp_path / "p" / "__init__.py")
    )
    assert git_commit() is None
    git_commit.cache_clear()


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


def test_unexpected_error_is_one_line(cli, work, monkeypatch):
    def broken(args):
        raise RuntimeError("two\nlines")

    monkeypatch.setattr(sje.common, "read_arm", broken)
    ran = cli("sje", "panda")
    assert ran.code == 1
    assert ran.lines == ["error: RuntimeError: two lines (STICTION_DEBUG=1 shows the traceback)"]
    monkeypatch.setenv("STICTION_DEBUG", "1")
    assert "Traceback" in cli("sje", "panda").err


def test_interrupt_says_how_to_go_on(cli, work, monkeypatch):
    def interrupt(args):
        raise KeyboardInterrupt

    monkeypatch.setattr(sje.common, "read_arm", interrupt)
    ran = cli("sje", "panda")
    assert ran.code == 1
    assert ran.lines == ["error: interrupted: nothing was written; run the same command again"]


def test_plain_json():
    import numpy as np

    value = {"a": np.array([1.0, np.nan]), 2: (np.float64(3), float("inf")), "b": True}
    assert plain(value) == {"a": [1.0, None], "2": [3.0, None], "b": True}
