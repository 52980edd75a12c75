"""Model files with numbers that no joint can have: one line says which."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnose import diagnose
from stiction_envs.gap.diagnosis import model_of
from stiction_envs.gap.extended_model import load_model
from stiction_envs.gap.model_file import dump, read
from tests.gap.small_logs import dry, hidden, panda

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


@pytest.mark.parametrize("value", ["1e308", "-1e308", "nan", "inf", "9" * 400, "9" * 5000])
@pytest.mark.parametrize("number", NUMBERS)
def test_a_number_that_no_joint_can_have_is_refused(number, value, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(changed(number, value), encoding="utf-8")
    expected = rf"nominal .*model\.toml: (\[arm\] )?({NUMBERS[number]}|or \[\[cause|not a TOML)"
    with pytest.raises(StictionError, match=expected) as error:
        read(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "9" * 5000])
@pytest.mark.parametrize("number", WHOLE)
def test_what_is_no_whole_number_is_refused(number, value, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(changed(number, value), encoding="utf-8")
    with pytest.raises(StictionError, match=r"model\.toml: (\[arm\] or \[\[cause|not a TOML file)"):
        read(path)


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
    path = tmp_path / "model.toml"
    path.write_text(dump(model_of(diagnose(turned, "panda").diagnosis)), encoding="utf-8")
    assert read(path).torque_sign == -1
    # a log that does not show it: nothing moves against gravity or friction
    still = replace(turned, q=np.tile(panda().rest, (len(turned.t), 1)), tau=0.0 * turned.tau)
    found = diagnose(still, "panda", nominal=path)
    assert any("as those of the diagnosed logs" in x for x in found.to_json()["notes"])
