"""The exported model sticks in stock MuJoCo: only ``mujoco.mj_step`` runs here."""

import json

import mujoco
import numpy as np
import pytest

from stiction_envs.friction.model import build
from stiction_envs.friction.parameters import dump_friction, friction_text, load_friction
from stiction_envs.friction.plain_mjcf import differences
from stiction_envs.robots import load_arm
from tests.robots.arms import MJCF, TETRA

STICTION = 4  # column of actuator_biasprm


def loaded(model: mujoco.MjModel, joint: str, factor: float, seconds: float) -> float:
    """Raise the torque on a joint to ``factor`` times stiction; return how far it went [rad]."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    act = model.actuator(f"{joint}_torque").id
    end = factor * model.actuator_biasprm[act, STICTION]
    start = data.joint(joint).qpos[0]
    late = start
    while data.time < seconds:
        x = min(1.0, data.time / 10.0)
        data.ctrl[act] = end * x * x * (3.0 - 2.0 * x)  # slow: a fast rise passes the ripple
        mujoco.mj_step(model, data)
        if data.time < seconds - 2:
            late = data.joint(joint).qpos[0]
    moved = data.joint(joint).qpos[0] - start
    if factor < 1:  # what counts is that it rests, presliding is no motion
        assert abs(data.joint(joint).qpos[0] - late) < 1e-6
    return float(moved)


@pytest.mark.parametrize(("robot", "joints"), [("panda", (2, 7)), ("iiwa7", (4, 6))])
def test_holds_under_and_goes_over_stiction(cli, robot, joints):
    assert cli("export", robot, "--out", "a").code == 0
    model = mujoco.MjModel.from_xml_path("a/model.xml")
    for j in joints:
        assert 0 < loaded(model, f"joint{j}", 0.9, 14.0) < 0.01
        assert loaded(model, f"joint{j}", 1.1, 14.0) > 0.1


@pytest.mark.parametrize("robot", ["panda", "iiwa7", "iiwa14"])
def test_equals_our_model(cli, robot):
    options = ["--payload", 1.3, 0, 0.01, 0.05, "--tilt", 0.1, -0.2]
    ran = cli("export", robot, "--out", "a", "--json", *options)
    assert ran.code == 0
    arm = load_arm(robot, payload=(1.3, 0, 0.01, 0.05), tilt=(0.1, -0.2))
    ours = build(arm, load_friction(robot))
    model = mujoco.MjModel.from_xml_path("a/model.xml")
    assert max(differences(model, ours).values()) <= 1e-9
    assert model.nu == arm.n
    np.testing.assert_array_equal(model.actuator_ctrlrange[:, 1], arm.limits.torque)
    said = [j["stiction_nm"] for j in json.loads(ran.out)["joints"]]
    np.testing.assert_array_equal(said, model.actuator_biasprm[:, STICTION])


def test_same_trajectory_as_our_model(cli):
    """A released, pushed arm moves alike in both, though ours has servos (of gain zero) too."""
    cli("export", "panda", "--out", "a")
    ours = build(load_arm("panda"), load_friction("panda"))
    model = mujoco.MjModel.from_xml_path("a/model.xml")
    a, b = mujoco.MjData(model), mujoco.MjData(ours.model)
    mujoco.mj_resetDataKeyframe(model, a, 0)
    b.qpos[:] = a.qpos
    a.ctrl[:] = 1.5
    b.ctrl[ours.torque_actuator] = 1.5
    for _ in range(500):
        mujoco.mj_step(model, a)
        mujoco.mj_step(ours.model, b)
    assert np.abs(a.qpos - model.key_qpos[0]).max() > 1e-3
    np.testing.assert_allclose(a.qpos, b.qpos, rtol=0, atol=1e-12)


def test_own_arm_with_defaults_frames_and_meshes(cli, inputs):
    (inputs / "assets").mkdir()
    (inputs / "assets" / "tetra.obj").write_text(TETRA)
    (inputs / "three.xml").write_text(MJCF)
    assert cli("export", inputs / "three.xml", "--out", "a").code == 0
    arm = load_arm(inputs / "three.xml")
    ours = build(arm, load_friction("generic", arm.n))
    model = mujoco.MjModel.from_xml_path("a/model.xml")
    assert max(differences(model, ours).values()) <= 1e-9


@pytest.mark.parametrize("name", ["model.toml", "friction.toml"])
def test_friction_from_a_folder(cli, inputs, name):
    p = load_friction("panda")
    text = dump_friction(
        p.replace(stiction=2 * p.stiction, load_coefficient=0 * p.load_coefficient),
        sources={k: "test" for k in friction_text("panda") if k not in ("meta", "provenance")},
        meta={},
        provenance={},
    )
    (inputs / name).write_text(text, encoding="utf-8")
    ran = cli("export", "panda", "--from", inputs, "--out", "a", "--json")
    assert ran.code == 0
    said = [j["stiction_nm"] for j in json.loads(ran.out)["joints"]]
    np.testing.assert_allclose(said, 2 * p.stiction.mean(axis=1))


@pytest.mark.parametrize("robot", ["panda", "iiwa7"])
def test_elastic_gears_are_named(cli, robot):
    ran = cli("export", robot, "--out", "a")
    said = [
        "with elastic gear" in x
        for x in ran.out.splitlines()
        if x.startswith("joint") and x[5].isdigit()
    ]
    np.testing.assert_array_equal(said, np.isfinite(load_friction(robot).joint_stiffness))


def test_comment_says_what_is_left_out(cli, work):
    cli("export", "panda", "--out", "a")
    text = (work / "a" / "model.xml").read_text("utf-8")
    for word in ("torque offsets", "direction", "on load", "Euler"):
        assert word in text.split("-->")[0]
