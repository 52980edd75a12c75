"""What a first contact loads: not more than it needs, since loading is most of its time."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("mujoco", "numba", "scipy", "pinocchio", "matplotlib", "optuna", "PIL")


def loaded(code: str) -> set[str]:
    """Return the modules that a fresh process has loaded after ``code``."""
    ran = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print('modules:', *sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(ran.stdout.rpartition("modules:")[2].split())


@pytest.mark.parametrize(
    "code",
    [
        "import stiction_envs",
        "from stiction_envs.cli import main; assert main(['--help']) == 0",
        "from stiction_envs.cli import main; assert main(['--version']) == 0",
    ],
    ids=["import", "help", "version"],
)
def test_the_package_and_its_help_load_nothing_heavy(code):
    assert loaded(code) & set(HEAVY) == set()


@pytest.mark.parametrize("name", ["PandaSJE-v0", "PandaGTE-v0"])
def test_an_environment_loads_only_what_it_needs(name):
    """SciPy's linear algebra comes with numba."""
    modules = loaded(f"import gymnasium; gymnasium.make('stiction_envs:{name}').reset(seed=0)")
    unwanted = {"scipy.signal", "scipy.stats", "scipy.spatial", "pinocchio", "matplotlib", "optuna"}
    assert modules & unwanted == set()


def test_the_version_is_printed(capsys):
    from stiction_envs import __version__
    from stiction_envs.cli import main

    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"stiction-envs {__version__}\n"
