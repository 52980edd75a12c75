"""An arm from outside the package, three files in a folder, works as one of the package."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.cli import main
from stiction_envs.experiments.sje.protocol import load_protocol
from stiction_envs.friction.parameters import QUANTITIES, dump_friction, load_friction
from stiction_envs.measured.tables import read_sje
from stiction_envs.robots import ARMS, BUILTIN, arm_title, load_arm, register_arm_folder
from tests.refusal import refusal
from tests.robots.arms import chain

TOML = """
name = "toy"
title = "Toy arm of three joints"
environment = "Toy" # ToySJE-v0, ToyGTE-v0
rest = { value = [0.0, 0.3, 0.5], unit = "rad", source = "own", trust = "G", assumed = true }

[limits]
torque = { value = [20.0, 20.0, 8.0], unit = "N*m", source = "own", trust = "G", assumed = true }

[experiments.sje]
iterations = { value = 2, unit = "1", source = "own", trust = "G", assumed = true }

[sources]
own = "made up for this test"
"""


def write_arm(folder: Path, name: str, toml: str, model: str = chain(3)) -> Path:
    for room in ("robots", "friction"):
        (folder / room).mkdir(parents=True, exist_ok=True)
    (folder / "robots" / f"{name}.xml").write_text(model)
    (folder / "robots" / f"{name}.toml").write_text(toml)
    return folder


@pytest.fixture(scope="module", autouse=True)
def toy(tmp_path_factory) -> Path:
    """Write the three files and register their folder, once."""
    folder = write_arm(tmp_path_factory.mktemp("arms"), "toy", TOML)
    text = dump_friction(
        load_friction("generic", 3).replace(stiction=np.array([[0.6] * 2, [0.5] * 2, [0.3] * 2])),
        sources=dict.fromkeys(QUANTITIES, "assumed: made up"),
        meta={"robot": "toy"},
        provenance={"method": "made up"},
    )
    (folder / "friction" / "toy.toml").write_text(text)
    assert register_arm_folder(folder) == ("toy",)
    return folder


def test_it_is_loaded_by_name():
    arm = load_arm("toy", payload=(0.2, 0, 0, 0.05))
    assert (arm.name, arm.joint_names, arm.registered) == ("toy", ("j1", "j2", "j3"), True)
    np.testing.assert_array_equal(arm.limits.torque, [20, 20, 8])
    np.testing.assert_array_equal(arm.rest, [0, 0.3, 0.5])
    np.testing.assert_array_equal(load_friction("toy", 3).stiction[:, 0], [0.6, 0.5, 0.3])
    assert load_protocol("toy") == load_protocol("other").replace(iterations=2)
    assert arm_title("toy") == "Toy arm of three joints"
    assert list(ARMS)[: len(BUILTIN) + 1] == [*BUILTIN, "toy"]


def test_the_command_line_knows_it(tmp_path, capsys):
    words = ["--joint", "3", "--no-scatter", "--load", "load", "--out", str(tmp_path / "a")]
    assert main(["sje", "toy", *words]) == 0
    rows = read_sje(tmp_path / "a" / "sje.csv")
    assert {(row.robot, row.iterations) for row in rows} == {("toy", 2)}
    assert main(["sje", "--help"]) == 0
    assert f"{', '.join(ARMS)}, or a path" in " ".join(capsys.readouterr().out.split())
    assert main(["sje", "toys", *words, "--force"]) == 2
    assert f"unknown robot 'toys': expected one of {', '.join(ARMS)}" in capsys.readouterr().err


BAD = {
    "no arm": ("", TOML, "no arm: expected NAME.xml and NAME.toml"),
    "name taken": ("panda", TOML, "arm 'panda': expected .* other than .*panda"),
    "no name": ("a b", TOML, "arm 'a b': expected letters"),
    "environment taken": ("new", 'environment = "Iiwa"', "'Iiwa': expected a name other than .*Ii"),
    "no environment": ("new", 'environment = "My Arm"', "environment 'My Arm': expected letters"),
    "no TOML": ("new", "environment = Toy", r"new\.toml: not a TOML file"),
}


@pytest.mark.parametrize(("name", "toml", "message"), BAD.values(), ids=BAD)
def test_bad_arm_folders_are_refused(tmp_path, name, toml, message):
    write_arm(tmp_path, "good", 'environment = "Good"')
    if name:
        write_arm(tmp_path, name, toml)
    else:
        (tmp_path / "robots" / "good.toml").unlink()
    refusal(lambda: register_arm_folder(tmp_path), message)
    assert "good" not in ARMS
    assert "GoodSJE-v0" not in gym.registry
