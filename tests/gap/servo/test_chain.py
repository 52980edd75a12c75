"""Servo logs of one leg of a robot whose base floats in its file."""

from pathlib import Path

import pytest

from benchmarks.servo.blind_servo_logs import robot_file
from stiction_envs.errors import StictionError
from stiction_envs.gap.diagnose import diagnose
from stiction_envs.gap.servo.servo_diagnosis import ServoDiagnosis
from stiction_envs.hidden.servo_logs import hide
from stiction_envs.robots import load_arm

ROBOT = str(Path(robot_file("so101")).parents[2] / "go2_description/urdf/go2.urdf")


@pytest.mark.slow
def test_a_leg_is_cut_out_and_its_base_held() -> None:
    leg = load_arm(ROBOT, chain=("base", "FL_foot"))
    case = hide(leg, ["coulomb_friction"], seed=3, seconds=30.0, scatter=0.0)
    leg_of = ("base", "FL_foot")
    found = diagnose([case.log], ROBOT, chain=leg_of, threads=1, **case.options).diagnosis
    assert isinstance(found, ServoDiagnosis)
    assert found.robot == "go2-base-FL_foot"
    named = {(c.name, j) for c in found.causes for j in c.joints}
    assert named == set(case.hidden)
    assert found.extended_rms.max() < 2e-3
    # the file as a whole is refused, and the message says how to choose a leg
    with pytest.raises(StictionError, match="take one arm: chain base FL_calf"):
        diagnose([case.log], ROBOT)
