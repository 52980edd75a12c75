"""Rotors of any size are found: on the joints of a KR 300 they have 600 to 850 kg·m²."""

import numpy as np
import pytest

from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.robots import load_arm
from tests.gap.small_logs import hidden

HEAVY = """<mujoco><compiler angle="radian"/><worldbody>
  <body><joint name="a1" axis="0 0 1" range="-3 3" actuatorfrcrange="-9000 9000"/>
    <geom type="box" size=".3 .3 .3" mass="900"/>
    <body pos="0 0 1"><joint name="a2" axis="0 1 0" range="-3 3" actuatorfrcrange="-9000 9000"/>
      <geom type="capsule" fromto="0 0 0 1.2 0 0" size=".15" mass="400"/>
    </body></body>
</worldbody></mujoco>"""


def test_a_rotor_of_an_industrial_arm_is_named(tmp_path):
    rotor = 700.0
    path = tmp_path / "heavy.xml"
    path.write_text(HEAVY)
    arm, first = load_arm(path), np.eye(2)[0]
    log = hidden(arm, lambda q, dq, ddq: rotor * ddq * first, noise=1.0)
    (cause,) = diagnose_logs([log], arm).causes
    assert (cause.name, cause.joints) == ("link_inertia", (1,))
    found = cause.parameters[1]["armature_kgm2"]
    assert found.ci95[0] < rotor < found.ci95[1]
    assert found.value == pytest.approx(rotor, rel=0.05)
