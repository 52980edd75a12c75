"""Links in 3-D: where MuJoCo has them, drawn as it draws them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs.gap.viewers import links
from stiction_envs.gap.viewers.links import body_poses, shapes
from stiction_envs.robots import load_arm
from tests.gap.servo.small_arm import two_links


def test_bodies_are_where_mujoco_has_them() -> None:
    arm = load_arm("panda")
    q = arm.rest + np.array([0.0, 0.3])[:, None]
    places, turns = body_poses(arm, q)
    model = arm.model()
    data = mujoco.MjData(model)
    data.qpos[:] = q[1]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(places[1], data.xpos, atol=1e-12)
    np.testing.assert_allclose(turns[1], data.xquat, atol=1e-12)
    assert not np.allclose(places[0, -1], places[1, -1], atol=0.01)


def test_what_the_viewer_of_mujoco_shows_is_drawn() -> None:
    model = load_arm("panda").model()
    found = shapes(model)
    assert len(found) == np.count_nonzero(model.geom_group < links.SHOWN)
    assert {x.link for x in found} == {int(b) for b in model.geom_bodyid}


def test_an_arm_without_shapes_is_a_chain_between_its_joints(tmp_path: Path) -> None:
    model = two_links(tmp_path).model()
    found = shapes(model)
    assert {x.kind for x in found} == {"capsule"}
    upper = next(x for x in found if x.link == model.body("upper").id)
    np.testing.assert_allclose(2 * upper.place, model.body("lower").pos)
    assert 2 * upper.size[1] == pytest.approx(0.3)
    axis = np.empty(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, 1.0]), upper.turn)
    np.testing.assert_allclose(axis, [1.0, 0.0, 0.0], atol=1e-12)


def test_meshes_are_drawn_as_they_are_or_as_hulls(monkeypatch: pytest.MonkeyPatch) -> None:
    box = "0 0 0 1 0 0 0 1 0 0 0 1 1 1 0 1 0 1 0 1 1 1 1 1"
    flat = "0 0 0 1 0 0 0 1 0 1 1 0"
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><default><geom contype="0" conaffinity="0"/></default>'
        f'<asset><mesh name="m" vertex="{box}"/>'
        f'<mesh name="f" vertex="{flat}" face="0 1 2 1 3 2" inertia="shell"/></asset><worldbody>'
        '<body><joint/><geom type="mesh" mesh="m"/>'
        '<geom type="mesh" mesh="f"/>'
        '<body pos="0 0 1"><joint/><geom size="0.1"/></body></body></worldbody></mujoco>'
    )
    mesh, sheet, ball = shapes(model)
    assert [x.kind for x in (mesh, sheet, ball)] == ["mesh", "mesh", "ellipsoid"]
    assert (ball.size == 0.1).all()
    monkeypatch.setattr(links, "FACES", 3)
    hull, ball = shapes(model)  # a sheet has no hull
    assert hull.vertices is not None
    assert hull.faces is not None
    assert mesh.vertices is not None
    assert len(hull.vertices) == len(mesh.vertices) == 8
    corners = hull.vertices[hull.faces].astype(float)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outside = np.sum(across * (corners.mean(axis=1) - hull.vertices.mean(axis=0)), axis=1)
    assert (outside > 0).all()
    # all faces of a cube of side one together enclose its volume
    assert np.sum(corners[:, 0] * across) / 6 == pytest.approx(1.0, rel=0.05)
    assert ball.kind == "ellipsoid"


def test_geoms_that_only_collide_are_not_drawn_too() -> None:
    seen = '<geom type="sphere" size="0.1" contype="0" conaffinity="0"/>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body><joint/>{seen}<geom type="box" size="1 1 1"/>'
        '<body><joint/><geom type="box" size="1 1 1"/></body></body></worldbody></mujoco>'
    )
    assert [(x.link, x.kind) for x in shapes(model)] == [(1, "ellipsoid"), (2, "box")]
