"""Links that touch in every pose are no collisions; links that touch in some are."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs.experiments.poses import find_poses
from stiction_envs.robots import load_arm
from stiction_envs.robots.overlapping_links import excluded_pairs

# the bulge of the base reaches over the first link to the second; the tip can meet the base
ARM = """
<mujoco model="bulge">
  <compiler angle="radian"/>
  <worldbody>
    <body name="base">
      <geom type="sphere" size="{bulge}" pos="0 0 0.1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
      <body name="one" pos="0 0 0.15">
        <joint name="a" axis="0 0 1" range="-2 2"/>
        <geom type="sphere" size="0.04"/>
        <inertial pos="0 0 0.05" mass="1" diaginertia="0.01 0.01 0.01"/>
        <body name="two" pos="0 0 0.08">
          <joint name="b" axis="0 1 0" range="-2.9 2.9"/>
          <geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.3"/>
          <inertial pos="0 0 0.15" mass="1" diaginertia="0.01 0.01 0.01"/>
          <body name="three" pos="0 0 0.3">
            <joint name="c" axis="0 1 0" range="-2.9 2.9"/>
            <geom type="capsule" size="0.03" fromto="0 0 0.06 0 0 0.3"/>
            <inertial pos="0 0 0.15" mass="1" diaginertia="0.01 0.01 0.01"/>
            <site name="flange" pos="0 0 0.3"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def bulge(tmp_path: Path) -> Path:
    path = tmp_path / "bulge.xml"
    path.write_text(ARM.format(bulge=0.12), "utf-8")
    return path


def touching(xml: str, q: list[float]) -> set[tuple[str, str]]:
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_fwdPosition(model, data)
    bodies = np.sort(model.geom_bodyid[data.contact.geom], axis=1)
    return {(model.body(a).name, model.body(b).name) for a, b in bodies}


def test_only_what_always_touches_is_left_out(bulge: Path):
    arm = load_arm(bulge)
    assert excluded_pairs(arm.xml) == [("base", "one"), ("base", "two")]
    assert touching(bulge.read_text("utf-8"), [0, 0, 0]) == {("base", "one"), ("base", "two")}
    assert touching(arm.xml, [0, 0, 0]) == set()
    folded = [0.0, 2.0, 2.2]
    assert ("base", "three") in touching(arm.xml, folded), "a real collision still counts"
    assert arm.notes() == [
        "bulge: links that touch in every pose are not called collisions: base and one, base and "
        "two"
    ]
    poses = find_poses(arm)
    assert all(not touching(arm.xml, list(q)) for q in poses.q.reshape(-1, 3))


def test_an_arm_rests_away_from_its_stops(tmp_path: Path):
    path = tmp_path / "stops.xml"
    text = ARM.format(bulge=0.005).replace(
        'axis="0 1 0" range="-2.9 2.9"', 'axis="0 1 0" range="0 2.8"', 1
    )
    path.write_text(text, "utf-8")
    np.testing.assert_allclose(load_arm(path).rest, [0.0, 1.4, 0.0])
