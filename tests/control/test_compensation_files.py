"""Files of gains: they read back bit for bit, and say what is wrong."""

import numpy as np
import pytest
import yaml

from stiction_envs.control.compensation import Compensation
from stiction_envs.control.compensation_files import (
    is_file,
    read_compensation,
    write_compensation,
    write_treatment,
)
from stiction_envs.control.laws import LAWS
from stiction_envs.errors import StictionError
from stiction_envs.friction.parameters import load_friction
from stiction_envs.measured.tables import AmplitudeRow, read_amplitudes
from stiction_envs.robots import load_arm
from tests.refusal import refusal

NAMES = load_arm("panda").joint_names
DITHER = [AmplitudeRow(7, 15.0, 0.8009660772725983)]


def drawn(kind: str, seed: int = 0) -> Compensation:
    """Numbers of no round value; one joint without."""
    rng = np.random.default_rng(seed)
    names = ("gain", *(f.name for f in LAWS[kind].fields))
    numbers = {name: rng.uniform(1e-9, 1.0, 7) for name in names}
    numbers["gain"][2] = 0.0
    return Compensation(kind=kind, **numbers)


@pytest.mark.parametrize("kind", LAWS)
def test_round_trip(tmp_path, kind):
    """compensation.csv and final.yaml, with or without the kind as an argument."""
    c = drawn(kind)
    write_treatment(tmp_path, DITHER, c, NAMES)
    for name in ("compensation.csv", "final.yaml"):
        assert is_file(tmp_path / name)
        for told in (None, kind):
            assert read_compensation(tmp_path / name, told, 7) == c
    assert read_amplitudes(tmp_path / "final.yaml", n_joints=7) == DITHER
    assert read_amplitudes(tmp_path / "final.csv", n_joints=7) == DITHER
    tree = yaml.safe_load((tmp_path / "final.yaml").read_text())["/**"]["ros__parameters"]
    assert list(tree) == ["dither", "compensation"]
    assert tree["compensation"]["kind"] == kind
    assert tree["compensation"]["joint1"]["gain_nm"] == c.gain[0]


def test_one_without_the_other(tmp_path):
    (tmp_path / "a").mkdir()
    write_treatment(tmp_path / "a", (), drawn("push"), NAMES)
    written = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert written == ["compensation.csv", "final.csv", "final.yaml"]
    assert read_compensation(tmp_path / "a" / "final.csv", None, 7) == drawn("push")
    with pytest.raises(StictionError, match="missing column 'frequency_hz'"):
        read_amplitudes(tmp_path / "a" / "final.csv", n_joints=7)
    with pytest.raises(StictionError, match="0 nodes with dither"):
        read_amplitudes(tmp_path / "a" / "final.yaml", n_joints=7)
    (tmp_path / "b").mkdir()
    write_treatment(tmp_path / "b", DITHER, None, NAMES)
    assert sorted(p.name for p in (tmp_path / "b").iterdir()) == ["final.csv", "final.yaml"]
    with pytest.raises(StictionError, match="0 nodes with compensation"):
        read_compensation(tmp_path / "b" / "final.yaml", None, 7)


def test_factor_multiplies_friction(tmp_path):
    c = Compensation.from_friction("lugre_observer", load_friction("panda", 7))
    write_compensation(tmp_path / "c.csv", c)
    twice = read_compensation(tmp_path / "c.csv", None, 7, factor=2.0)
    assert twice == c.times(2.0)
    assert twice.numbers["coulomb"][0] == 2 * c.numbers["coulomb"][0]
    assert twice.numbers["injection"] == c.numbers["injection"]


def test_missing_numbers_are_the_defaults(tmp_path):
    path = tmp_path / "c.csv"
    path.write_text("joint,kind,gain_nm,speed_rad_s,error_rad\n2,push,0.8,0.1,\n7,push,0.5,,\n")
    c = read_compensation(path, None, 7)
    usual = Compensation(kind="push", gain=(1.0,) * 7).numbers
    assert c.gain == (0.0, 0.8, 0.0, 0.0, 0.0, 0.0, 0.5)
    assert c.numbers == usual | {"speed": (usual["speed"][0], 0.1, *usual["speed"][2:])}


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        ("joint,gain_nm\n1,1\n", None, "no kind: expected a column kind"),
        ("joint,gain_nm,kind\n1,1,pull\n", None, "'pull': expected one of feedforward"),
        ("joint,gain_nm,kind\n1,1,push\n", "feedforward", "'push': expected one of feedforward"),
        ("joint,gain_nm,kind\n1,1,push\n2,1,partial\n", None, "'partial': expected one of push"),
        ("joint,gain_nm\n1,1\n", "pull", "unknown compensation 'pull'"),
        ("joint,gain_nm,rate_1_s\n1,1,2\n", "push", "rate_1_s: push has none: expected gain_nm"),
        ("joint,gain_nm,weight\n1,1,2\n", "push", "weight"),
        ("joint,gain_nm\n1,1\n", "lugre_observer", "joint 1: lugre_observer needs coulomb_nm"),
        ("joint,gain_nm,share\n1,1,2\n", "momentum_observer", "share of joint 1 is 2"),
        ("joint,gain_nm\n8,0.5\n", "push", "1 to 7"),
        ("joint,gain_nm\n1,0.5\n1,0.5\n", "push", "twice"),
        ("joint,gain_nm\n1,-0.5\n2,1\n", "push", "expected >= 0"),
        ("joint,gain_nm\n1,nan\n", "push", "finite"),
        ("joint,gain_nm\n1,0\n", "push", "compensates no joint"),
        ("joint,gain\n1,1\n", "push", "gain_nm"),
    ],
)
def test_bad_files(tmp_path, text, kind, words):
    path = tmp_path / "c.csv"
    path.write_text(text)
    refusal(lambda: read_compensation(path, kind, 7), words)
