"""Solids of a MuJoCo model as Rerun draws them."""

from __future__ import annotations

import mujoco

from stiction_envs.reporting import rerun_solids


def test_the_solids_that_mujoco_s_viewer_shows_are_drawn() -> None:
    """Geoms that only collide are not drawn where a link has others."""
    kinds = {
        "box": 'type="box" size="1 1 1"',
        "ball": 'type="sphere" size="0.1"',
        "ellipsoid": 'type="ellipsoid" size="1 2 3"',
        "cylinder": 'type="cylinder" size="0.1 1"',
        "capsule": 'type="capsule" size="0.1 1"',
        "mesh": 'type="mesh" mesh="m"',
    }
    seen = "".join(f'<geom {x} contype="0" conaffinity="0"/>' for x in kinds.values())
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset><worldbody>'
        f'<body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{seen}'
        '<geom type="box" size="1 1 1"/><geom group="3" size="1"/></body></worldbody></mujoco>'
    )
    solids = rerun_solids._geoms(model, (1, 2, 3))
    drawn = [[type(x).__name__ for x in solid] for _, solid in solids]
    assert drawn == [
        *(["Boxes3D"], ["Ellipsoids3D"], ["Ellipsoids3D"], ["Cylinders3D"], ["Capsules3D"]),
        ["Transform3D", "Mesh3D"],
    ]
