"""What an exported model says of itself."""

from __future__ import annotations

import mujoco

from stiction_envs.friction.export import export
from stiction_envs.robots.stated import COULOMB, STICTION


def test_its_text_has_the_friction_of_every_joint():
    """The numbers are those that the model itself has."""
    exported = export("panda")
    model = mujoco.MjModel.from_xml_string(exported.xml)
    header, *lines = str(exported).splitlines()
    assert header.split() == ["joint", "stiction", "[N·m]", "Coulomb", "[N·m]"]
    assert [x.split()[0] for x in lines] == list(exported.sticking.arm.joint_names)
    for line in lines:
        name, stiction, coulomb, *_ = line.split()
        level = model.actuator_biasprm[model.actuator(f"{name}_torque").id]
        assert [stiction, coulomb] == [f"{level[STICTION]:.4f}", f"{level[COULOMB]:.4f}"]
    assert [x.endswith("  with elastic gear") for x in lines] == [True] * 4 + [False] * 3
