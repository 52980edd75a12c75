"""Every command and every line of Python in the README runs as it is printed."""

import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from stiction_envs.measured.tables import read_amplitudes, read_sje
from tests.command_line import ROOT, python
from tests.gap.small_logs import hidden, panda, sticky, write_csv

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.S)


def commands() -> list[str]:
    lines = [line.split("#")[0].strip() for block in blocks("sh") for line in block.splitlines()]
    return [line for line in lines if line]


def made_by(target: str) -> list[str]:
    """Return the commands of ``make target`` once the environment exists."""
    made = [f"-o.venv/.stamp-{kind}-{platform.python_version()}" for kind in ("run", "dev")]
    shown = subprocess.run(
        ["make", "--no-print-directory", "-n", target, f"PYTHON={sys.executable}", *made],
        cwd=ROOT,
        # a make above this one (make test) would pass its flags on
        env={k: v for k, v in os.environ.items() if not k.startswith("MAKE")},
        capture_output=True,
        text=True,
        check=True,
    )
    return shown.stdout.splitlines()


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """An empty folder that looks like the checkout to the commands, and their environment."""
    folder = tmp_path_factory.mktemp("readme")
    (folder / "stiction_envs").symlink_to(ROOT / "stiction_envs")
    return folder


def run(command: str, place: Path) -> str:
    environment = dict(os.environ, PYTHONPATH=str(ROOT), MUJOCO_GL="egl")
    words = command.split()
    if words[0] in ("stiction", ".venv/bin/stiction"):
        code = "import sys; from stiction_envs.cli import main; sys.exit(main(sys.argv[1:]))"
        words = [sys.executable, "-c", code, *words[1:]]
    elif words[0] == "python":
        words[0] = sys.executable
    done = subprocess.run(
        words, cwd=place, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_what_it_shows_exists():
    for path in re.findall(r"\]\(([\w./-]+\.png)\)", README):
        assert (ROOT / path).is_file()


def test_make_test_lints_checks_types_and_tests():
    text = "\n".join(made_by("test"))
    for word in ("ruff check", "ruff format --check", "mypy", 'pytest -m "not slow"'):
        assert word in text


def test_make_test_all_leaves_no_test_out():
    asked = [line.partition("pytest ")[2] for line in made_by("test-all") if "/pytest" in line]
    assert asked == ['-m "not slow"', "-m slow"]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_all_commands(place):
    """In the order printed: later ones use what earlier ones wrote."""
    wanted = commands()
    assert wanted[0] == "make tune"
    for command in wanted:
        if command in ("make test", "make test-all"):
            continue  # that is this run; see test_make_test_lints_checks_types_and_tests
        for line in made_by("tune") if command == "make tune" else [command]:
            run(line, place)
    final = read_amplitudes(place / "runs" / "panda" / "final.csv", n_joints=7)
    assert [row.joint for row in final] == list(range(1, 8))
    printed = [line.split("|")[2:4] for line in README.splitlines() if re.match(r"\| \d \|", line)]
    assert [(f"{r.frequency_hz:g}", f"{r.amplitude_nm:.2f}") for r in final] == [
        (f.strip(), a.strip()) for f, a in printed
    ], "the README's table is not what make tune writes"
    assert {r.joint for r in read_sje(place / "runs" / "sje-panda" / "sje.csv")} == {7}


@pytest.mark.slow
def test_the_library(place):
    """Dry friction of 0.5 N·m in a log is named, and holds the arm of the model that is loaded."""
    write_csv(place / "log.csv", hidden(panda(), sticky))
    ran = python(blocks("python")[1], cwd=place)
    assert "coulomb_friction" in ran.stdout, ran.stderr
    assert (place / "runs" / "why" / "report.html").is_file()


def test_the_environment(place):
    ran = python(blocks("python")[0], cwd=place)
    with_dither, without = map(float, re.findall(r"([\d.]+) N·m", ran.stdout))
    assert 0 < with_dither < 0.8 * without


# ---- the Makefile builds the environment of the Python that it is given, and of no other ---------


def make_env(folder: Path) -> None:
    """Build the environment without its packages."""
    command = ["make", "env", "PIP=true", f"PYTHON={sys.executable}"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)


@pytest.mark.slow
def test_an_environment_of_another_python_is_rebuilt(tmp_path: Path):
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    left = tmp_path / ".venv" / "lib" / "python3.10" / "left"
    left.parent.mkdir(parents=True)
    left.touch()
    for kind in ("run", "dev"):
        (tmp_path / ".venv" / f".stamp-{kind}-3.10.1").touch()
    make_env(tmp_path)
    assert not left.exists()
    stamp = tmp_path / ".venv" / f".stamp-dev-{platform.python_version()}"
    made = stamp.stat().st_mtime_ns
    make_env(tmp_path)
    assert stamp.stat().st_mtime_ns == made  # nothing to do
