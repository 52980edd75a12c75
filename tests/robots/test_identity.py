"""An arm is what its files say, not what they are called."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from stiction_envs.cli.view import usual_dither
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.friction.parameters import GENERIC, QUANTITIES, load_friction
from stiction_envs.friction.sticking import friction_file, sticking_model
from stiction_envs.robots import ARMS, arm_title, load_arm
from tests.robots.arms import chain


@pytest.fixture(scope="module")
def stranger(tmp_path_factory) -> Path:
    """Another robot of seven joints whose file is called as the Panda's."""
    path = tmp_path_factory.mktemp("strangers") / "panda.xml"
    path.write_text(chain(7), "utf-8")
    return path


def same_friction(one, other) -> bool:
    return all(np.array_equal(getattr(one, q), getattr(other, q)) for q in QUANTITIES)


def test_a_strangers_file_is_no_arm_of_ours_whatever_its_name(stranger: Path):
    arm = load_arm(stranger)
    assert (arm.name, arm.registered_name, arm_title(arm.name)) == ("panda.xml", None, "panda.xml")
    assert friction_file(arm) == GENERIC
    model = sticking_model(stranger)
    assert same_friction(model.parameters, load_friction(None))
    assert not same_friction(model.parameters, load_friction("panda"))
    assert usual_dither(model) != list(thesis_final_dither())


@pytest.mark.parametrize("name", ["panda", "iiwa7"])
def test_a_copy_of_an_arm_of_the_package_is_that_arm(tmp_path: Path, name: str):
    copy = tmp_path / "mine.xml"
    shutil.copyfile(ARMS[name].model, copy)
    arm = load_arm(copy)
    assert arm.registered_name == arm.name == name
    assert arm.fingerprint == load_arm(name).fingerprint
    assert friction_file(arm) == friction_file(load_arm(name))
    shutil.copyfile(ARMS[name].toml, copy.with_suffix(".toml"))
    assert load_arm(copy).registered_name == name
    copy.with_suffix(".toml").write_text("[limits.torque]\nvalue = 20\n", "utf-8")
    other = load_arm(copy)
    assert (other.name, other.registered_name) == ("mine", None)
    np.testing.assert_array_equal(other.limits.torque, 20)
