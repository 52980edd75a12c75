"""Users' files: an MJCF or URDF becomes a rigid arm, or is refused in one clear line."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs.friction.export import plain_mjcf
from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import load_friction
from stiction_envs.robots import load_arm
from tests.refusal import refusal
from tests.robots.arms import chain, flange, write_arms


@pytest.fixture
def own(tmp_path: Path) -> Path:
    return write_arms(tmp_path)


def test_own_mjcf_becomes_a_rigid_arm(own: Path):
    arm = load_arm(own / "three.xml")
    before, after = mujoco.MjModel.from_xml_path(str(own / "three.xml")), arm.model()
    assert (arm.name, arm.registered, arm.n) == ("three", False, 3)
    assert arm.joint_names == ("a", "b", "c")
    assert arm.link_names == ("one", "link3", "three")
    assert arm.end_effector == "attachment_site"
    assert (after.nq, after.nu, after.ntendon, after.neq, after.nkey) == (3, 0, 0, 0, 0)
    for passive in (after.dof_armature, after.dof_damping, after.dof_frictionloss):
        assert not passive.any()
    assert not after.jnt_stiffness.any()
    assert not after.body_gravcomp.any()
    # Nothing is rounded, and the fingers still weigh.
    np.testing.assert_array_equal(after.body_mass, before.body_mass)
    np.testing.assert_array_equal(after.body_inertia, before.body_inertia)
    np.testing.assert_allclose(after.body_ipos, before.body_ipos, atol=1e-15)
    # Joint a: actuator forcerange; b: actuatorfrcrange; c: motor with gear 10 and control +-2.
    np.testing.assert_allclose(arm.limits.torque, [87, 55, 20])
    np.testing.assert_allclose(arm.limits.position[0], np.deg2rad([-123.456789, 120]), rtol=1e-15)
    np.testing.assert_allclose(arm.rest, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(arm.limits.velocity, 2.5)
    assert np.isinf(arm.limits.torque_rate).all()


def test_the_fingerprint_knows_the_files_that_the_text_names(own: Path):
    before, seen = load_arm(own / "three.xml"), load_arm(own / "three.xml").fingerprint
    assert before.fingerprint == seen
    mesh = own / "assets" / "tetra.obj"
    mesh.write_text(mesh.read_text("utf-8") + "# other\n", "utf-8")
    after = load_arm(own / "three.xml")
    assert after.xml == before.xml
    assert after.fingerprint != seen
    assert load_arm(own / "three.xml", tilt=(0.0, 0.1)).fingerprint != after.fingerprint


def test_own_urdf(own: Path):
    arm = load_arm(own / "two.urdf")
    assert arm.joint_names == ("shoulder", "elbow")
    assert arm.link_names == ("upper", "lower")
    assert arm.end_effector == "flange"
    # effort and velocity of the shoulder; the elbow has none and turns freely.
    np.testing.assert_array_equal(arm.limits.torque, [33, 100])
    np.testing.assert_array_equal(arm.limits.velocity, [2.2, 2.5])
    np.testing.assert_allclose(arm.limits.position, [[-1.5, 2], [-np.pi, np.pi]])
    assert not arm.model().jnt_limited[1]
    assert not arm.model().dof_damping.any()
    # The missing .dae is left out, the mesh that is there is not.
    assert arm.model().nmesh == 1
    aside, up = -0.25 * np.sin(0.3), 0.5 + 0.25 * np.cos(0.3)
    np.testing.assert_allclose(flange(arm, np.zeros(2))[:3, 3], [0, aside, up])
    lying = load_arm(own / "two.urdf", tilt=(0, np.pi / 2))
    np.testing.assert_allclose(flange(lying, np.zeros(2))[:3, 3], [up, aside, 0], atol=1e-9)


def test_toml_beside_an_own_file(own: Path):
    (own / "two.toml").write_text(
        "[limits.torque]\nvalue = [7, 8]\n[limits.torque_rate]\nvalue = 500\n"
        "[rest]\nvalue = [0.5, 0.25]\n[interface.controller_rate_hz]\nvalue = 250\n"
    )
    arm = load_arm(own / "two.urdf")
    np.testing.assert_array_equal(arm.limits.torque, [7, 8])
    np.testing.assert_array_equal(arm.limits.torque_rate, [500, 500])
    np.testing.assert_array_equal(arm.rest, [0.5, 0.25])
    assert (arm.controller_rate_hz, arm.lowpass_hz) == (250, 0)


def test_payload_on_a_site_of_an_own_file(own: Path):
    before, after = load_arm(own / "three.xml"), load_arm(own / "three.xml", payload=(2, 0, 0, 0.1))
    model = after.model()
    site, body = model.site("attachment_site"), model.body("payload")
    assert body.parentid == site.bodyid
    np.testing.assert_allclose(body.quat, site.quat)
    assert model.body_mass.sum() == pytest.approx(before.model().body_mass.sum() + 2)


BALL = chain(3).replace('type="hinge"', 'type="ball"', 1)
FREE = chain(3).replace('<joint name="j1" type="hinge" axis="0 1 0"/>', "<freejoint name='f'/>")
TWICE = chain(3).replace("<geom", '<joint name="extra" axis="1 0 0"/><geom', 1)
BRANCH = '<body name="b"><joint name="side"/><geom size="0.1" mass="1"/></body>'
BRANCHED = chain(3).replace('<body name="l2"', f'{BRANCH}<body name="l2"')

REFUSED = {
    "no_mass": (chain(3, mass="0"), r"moving link 'l\d' has no mass or inertia"),
    "none": (chain(0), "0 hinge joints: expected 1 to 9"),
    "ten": (chain(10), "10 hinge joints: expected 1 to 9"),
    "ball": (BALL, "joint 'j1' is a ball joint: expected hinges only"),
    "free": (FREE, "joint 'f' is a free joint: expected hinges only"),
    "twice": (TWICE, "link 'l1' has two joints"),
    "branch": (BRANCHED, "the chain branches: joint 'j2' is not behind joint 'side'"),
    "ref": (chain(3).replace('axis="0 1 0"', 'axis="0 1 0" ref="10"', 1), "has a ref angle"),
    "schema": ("<mujoco><bla/></mujoco>", "not a readable MJCF or URDF"),
    "not_xml": ("hello", "not a readable MJCF or URDF"),
    "mesh": (
        chain(3, extra='<geom type="mesh" mesh="m"/>').replace(
            "<worldbody>", '<asset><mesh name="m" file="missing.stl"/></asset><worldbody>'
        ),
        "MuJoCo cannot build it",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_files(tmp_path: Path, case: str):
    text, message = REFUSED[case]
    path = tmp_path / f"{case}.xml"
    path.write_text(text)
    assert case in refusal(lambda: load_arm(path), message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[limits.torque]\nvalue = [1, 2, 3]",
            r"two\.toml, limits\.torque has shape \(3,\): expected",
        ),
        ("[limits.torque]\nvalue = [1, nan]", "contains NaN"),
        ('[rest]\nvalue = ["a", "b"]', "rest is a list: expected numbers"),
        ("[rest", "not a TOML file"),
    ],
)
def test_bad_toml_beside_an_own_file(own: Path, text: str, message: str):
    (own / "two.toml").write_text(text)
    assert "two.toml" in refusal(lambda: load_arm(own / "two.urdf"), message)


@pytest.mark.parametrize("robot", ["panda", "two.urdf"])
def test_limits_and_rest_survive_being_written(own: Path, robot: str):
    """An exported and an identified arm keep them bit for bit."""
    arm = load_arm(robot if robot == "panda" else own / robot)
    sticking = build(arm, load_friction("generic", arm.n))
    texts = {"rigid": arm.carrying_xml(), "sticking": plain_mjcf(sticking, friction_name="x")}
    for name, text in texts.items():
        path = own / f"{name}.xml"
        path.write_text(text, "utf-8")
        again = load_arm(path)
        for field in ("position", "velocity", "torque", "torque_rate"):
            np.testing.assert_array_equal(getattr(again.limits, field), getattr(arm.limits, field))
        np.testing.assert_array_equal(again.rest, arm.rest)


BOUNDED = {
    "limits.position": "rad",
    "limits.velocity": "rad/s",
    "limits.torque": "N·m",
    "limits.torque_rate": "N·m/s",
    "interface.controller_rate_hz": "Hz",
    "interface.lowpass_hz": "Hz",
    "rest": "rad",
}


@pytest.mark.parametrize("value", [1e308, -1e308, float("inf"), float("-inf")])
@pytest.mark.parametrize("key", BOUNDED)
def test_a_number_that_no_joint_can_have_is_refused(key, value, own: Path):
    """The error names number, place and expected range; only a torque rate may be infinite."""
    (own / "two.toml").write_text(f"[{key}]\nvalue = {value}\n")
    if (key, value) == ("limits.torque_rate", float("inf")):
        assert np.isinf(load_arm(own / "two.urdf").limits.torque_rate).all()
        return
    line = rf"two\.toml, {re.escape(f'{key}: {value:g} {BOUNDED[key]}')}: expected "
    refusal(lambda: load_arm(own / "two.urdf"), line)
