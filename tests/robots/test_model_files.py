"""Arms by a folder of Menagerie's layout, and by a name of robot_descriptions."""

import importlib
import sys
from pathlib import Path

import pytest

from stiction_envs.experiments.conformance import conformance
from stiction_envs.friction.sticking import friction_file
from stiction_envs.robots import load_arm
from stiction_envs.robots.registry import PACKAGE, known_arm, robot_files
from tests.refusal import refusal
from tests.robots.arms import write_arms

SCENE = (
    '<mujoco><include file="{}"/><worldbody><geom type="plane" size="1 1 1"/></worldbody></mujoco>'
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with several models, of which the scene includes one."""
    write_arms(tmp_path)
    (tmp_path / "scene.xml").write_text(SCENE.format("three.xml"))
    return tmp_path


def test_a_folder_is_the_arm_that_its_scene_includes(folder: Path) -> None:
    arm = load_arm(folder)
    assert arm.name == "three"
    assert arm.xml == load_arm(folder / "three.xml").xml
    assert load_arm(str(folder)).joint_names == arm.joint_names
    assert robot_files(folder)["robot"] == folder / "three.xml"
    assert friction_file(arm).name == "generic.toml"


def test_a_folder_with_one_model_needs_no_scene(folder: Path, tmp_path: Path) -> None:
    (folder / "scene.xml").unlink()
    refusal(lambda: load_arm(folder), r"its models are .*: expected scene.xml that includes")
    alone = tmp_path / "alone"
    (alone / "assets").mkdir(parents=True)
    (alone / "panda.xml").write_bytes((PACKAGE / "robots" / "panda.xml").read_bytes())
    known = known_arm(alone)
    assert known is not None
    assert known.name == "panda"
    assert load_arm(alone).registered


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("no xml", "no XML"),
        (SCENE.format("gone.xml"), "its models are none"),
        (SCENE.format("three.xml").replace("<world", '<include file="two.xml"/><world'), "its mod"),
        ("\0", "no XML"),
    ],
)
def test_a_scene_without_one_arm_is_one_clear_line(folder: Path, text: str, says: str) -> None:
    (folder / "scene.xml").write_text(text)
    (folder / "two.xml").write_text("<mujoco/>")
    for of in (load_arm, robot_files, conformance):
        assert "expected" in refusal(lambda of=of: of(folder), says)


PART = {
    "__init__": "",
    "_repositories": "class R:\n    cache_path = 'zoo'\nREPOSITORIES = {'mujoco_menagerie': R}\n",
    "_cache": "def clone_to_cache(name, commit=None):\n    raise RuntimeError('downloads')\n",
    "toy_mj_description": "from os import path\nfrom ._cache import clone_to_cache as _clone\n"
    "REPOSITORY_PATH = _clone('mujoco_menagerie')\n"
    "MJCF_PATH = path.join(REPOSITORY_PATH, 'toy', 'three.xml')\n",
}
"""The package as far as it is used. Source: robot_descriptions 3.3, _cache.py."""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for the package, and its empty cache."""
    package = tmp_path / "site" / "robot_descriptions"
    package.mkdir(parents=True)
    for name, text in PART.items():
        (package / f"{name}.py").write_text(text)
    for name in [x for x in sys.modules if x.startswith("robot_descriptions")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "cache"))
    importlib.invalidate_caches()
    yield tmp_path / "cache"
    for name in [x for x in sys.modules if x.startswith("robot_descriptions")]:
        del sys.modules[name]


def test_a_description_in_the_cache(cache: Path) -> None:
    says = r"zoo is missing: .* robot_descriptions.toy_mj_desc"
    refusal(lambda: load_arm("toy_mj_description"), says)
    (cache / "zoo" / "toy").mkdir(parents=True)
    refusal(lambda: load_arm("toy_mj_description"), "expected a file there")
    write_arms(cache / "zoo" / "toy")
    assert load_arm("toy_mj_description").name == "three"
    assert robot_files("toy_mj_description")["robot"] == cache / "zoo" / "toy" / "three.xml"
    # what others import still downloads
    from robot_descriptions import _cache  # type: ignore[import-not-found]

    with pytest.raises(RuntimeError, match="downloads"):
        _cache.clone_to_cache("mujoco_menagerie")


def test_descriptions_that_are_not_there(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refusal(lambda: load_arm("pyramid_description"), "has no such model")
    monkeypatch.setitem(sys.modules, "robot_descriptions._cache", None)
    says = r"pip install 'stiction-envs\[descriptions\]'"
    refusal(lambda: load_arm("toy_mj_description"), says)
    refusal(lambda: load_arm("toy"), "unknown robot 'toy'")
