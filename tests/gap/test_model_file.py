"""Model files with numbers that no joint can have: one line says which."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnose import diagnose
from stiction_envs.gap.extended_model import load_model
from stiction_envs.gap.model_file import nominal_of, read
from tests.gap.small_logs import dry, hidden, panda, write_model
from tests.refusal import refusal

NUMBERS = {
    "payload = [0.5": "payload",
    "tilt = [0.1": "tilt",
    "distance = [6e-05": "distance",
    "shape = [3.0": "cause link_parameters on joint 3",
    "coefficients = [-0.1": "cause link_parameters on joint 3",
}
"""Each number of the file, and what a refusal of it names."""
WHOLE = ("joint = 3", "level = 1")
MODEL = """
[arm]
robot = "own"
payload = [0.5, 0.0, 0.0, 0.1]
tilt = [0.1, 0.0]
distance = [6e-05, 6e-05, 6e-05]

[[cause]]
name = "link_parameters"
joint = 3
shape = [3.0, 0.6763]
coefficients = [-0.1, 0.001, -0.008, -0.001]
level = 1
carried = true
"""


def changed(number: str, value: str) -> str:
    assert MODEL.count(number) == 1
    return MODEL.replace(number, re.sub(r"[-\d.e]+$", value, number))


@pytest.mark.parametrize("value", ["-1e308", "nan", "9" * 400, "9" * 5000])
@pytest.mark.parametrize("number", NUMBERS)
def test_a_number_that_no_joint_can_have_is_refused(number, value, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(changed(number, value), encoding="utf-8")
    expected = rf"nominal .*model\.toml: (\[arm\] )?({NUMBERS[number]}|or \[\[cause|not a TOML)"
    refusal(lambda: read(path), expected)


BARE = "[arm]\nrobot='panda'\npayload=[]\ntilt=[0,0]\ndistance=[]\n"
FORM = "is not as stiction diagnose writes it"
ROWS = "[links] covariance_factor: expected rows"


def table(name: str, joint: int, shape: str, coefficients: str) -> str:
    numbers = f"joint={joint}\nshape={shape}\ncoefficients={coefficients}\nlevel=1\n"
    return f"[[cause]]\nname='{name}'\n{numbers}"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "m.toml"),
        ("[arm]\nrobot = 'panda'\n", FORM),
        (BARE.replace("payload=[]", "payload=[1.0]"), "payload"),
        (BARE.replace("panda", "iiwa7"), "of robot iiwa7"),
        ("no toml", "not a TOML file"),
        *(
            (BARE + more, says)
            for more, says in (
                (table("magic", 1, "[]", "[1]"), "unknown cause 'magic'"),
                (table("payload", 1, "[]", "[1]"), "cause payload on joint 1: expected 0"),
                (table("torque_offset", 0, "[]", "[1]"), "torque_offset on joint 0: expected 1"),
                (table("payload", 0, "[]", "[1,0.1,0,0,0,0,0,0,0,0]"), "no body has the parameter"),
                (table("link_parameters", 3, "[3.0,3.2]", "[-9,0,0,0]"), "link 3"),
                ("torque_lag = [0.1]", "torque_lag has 1 numbers: expected 2"),
                ("torque_lag = [-0.1, 0.0]", "torque_lag: -0.1 s: expected 0 to"),
                ("torque_lag = [nan, 0.0]", "torque_lag: nan s"),
                ('torque_lag = ["late", 0.0]', FORM),
                ("sessions = [[2.0, 1.0]]", "sessions: 2 to 1 s: expected increasing dates"),
                ("sessions = [[nan, 1.0]]", "sessions: nan to 1 s"),
                ("sessions = [1.0]", FORM),
                ("[links]\ncovariance_factor = [[1.0], [2.0, 3.0]]", ROWS),
                ('[links]\ncovariance_factor = [["a"]]', ROWS),
                ("[links]\ncovariance_factor = [[nan]]", ROWS),
                ("[links]\ncovariance_factor = [[1.0], [2.0]]", "[links] has 2 rows: expected 70"),
            )
        ),
    ],
)
def test_a_broken_file_is_refused_in_one_line(tmp_path, text, says):
    path = tmp_path / "m.toml"
    path.write_text(text)
    assert "m.toml" in refusal(lambda: nominal_of(panda(), path), re.escape(says))


@given(number=st.sampled_from([*NUMBERS, *WHOLE]), value=st.floats())
def test_every_number_is_read_or_refused(number, value, tmp_path_factory):
    path = tmp_path_factory.mktemp("odd") / "model.toml"
    path.write_text(changed(number, repr(value)), encoding="utf-8")
    try:
        found = read(path)
    except StictionError as refused:
        line = str(refused)
        assert "\n" not in line
        ordinary = number in NUMBERS and 1e-3 < value < 1.0
        assert not ordinary, line
        return
    for part in found.parts:
        assert all(abs(x) <= 1e12 for x in (*part.shape, *part.coefficients))
    assert found.payload is not None
    assert 0 <= found.payload[0] <= 1e6


@pytest.mark.slow
def test_known_bodies_and_inclinations_come_on_top_of_a_model(tmp_path):
    """A bare arm is diagnosed; then a known gripper is mounted, and the base is inclined."""
    gripper, tilt = (0.7, 0.0, 0.01, 0.05), (0.1, -0.05)
    bare = hidden(panda(), dry, seconds=15.0)
    first = diagnose(bare, "panda")
    assert [c.name for c in first.causes] == ["coulomb_friction"]
    first.save(tmp_path / "bare")
    model = tmp_path / "bare" / "model.toml"
    log = hidden(panda(payload=gripper, tilt=tilt), dry, seconds=15.0, seed=2)
    again = diagnose(log, "panda", nominal=model, payload=gripper, tilt=tilt)
    assert again.verdict == "no discrepancy"
    assert [c.name for c in diagnose(log, "panda", nominal=model, tilt=tilt).causes] == ["payload"]
    again.save(tmp_path / "loaded")
    assert read(tmp_path / "loaded" / "model.toml").payload == gripper
    loaded = load_model(tmp_path / "loaded" / "model.toml").arm
    for arm in (loaded, load_model(model, payload=gripper, tilt=tilt).arm):
        assert (arm.payload, arm.tilt) == (gripper, tilt)


def test_a_model_knows_the_sign_of_the_robots_torques(tmp_path):
    turned = hidden(panda(), dry)
    turned = replace(turned, tau=-turned.tau)
    path = write_model(tmp_path, diagnose(turned, "panda").diagnosis)
    assert read(path).torque_sign == -1
    # a log that does not show it: nothing moves against gravity or friction
    still = replace(turned, q=np.tile(panda().rest, (len(turned.t), 1)), tau=0.0 * turned.tau)
    found = diagnose(still, "panda", nominal=path)
    assert any("as those of the diagnosed logs" in x for x in found.to_json()["notes"])
