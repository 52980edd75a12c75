from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs import diagnose
from stiction_envs.gap.causes.body.bodies import sphere, with_payload
from stiction_envs.gap.causes.body.payload import LEAST_INERTIA
from stiction_envs.gap.report.results import ServoResult
from stiction_envs.gap.servo.motion import joint_motions
from stiction_envs.gap.servo.questions import Servo, nominal_parameters
from stiction_envs.gap.servo.servo_diagnosis import diagnose_servo
from stiction_envs.gap.servo.servo_payload import gravity_of_tip, proposed
from stiction_envs.hidden.servo_logs import hide
from stiction_envs.robots import load_arm
from tests.gap.servo.small_arm import two_links

START = np.array([-0.6, 0.8])


def test_gravity_of_a_body_at_the_tip_is_that_of_mujoco() -> None:
    arm = load_arm("panda", tilt=(0.2, -0.1))
    body = (1.3, 0.02, -0.05, 0.11)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, size=(5, arm.n))
    mass, *com = body
    torque = gravity_of_tip(arm, q) @ np.array([mass, *(mass * x for x in com)])
    loaded = with_payload(arm, sphere(mass, np.array(com)), LEAST_INERTIA)
    for pose, expected in zip(q, torque, strict=True):
        held = []
        for model in (arm.model(), loaded.model()):
            data = mujoco.MjData(model)
            data.qpos[:] = pose
            mujoco.mj_forward(model, data)
            held.append(data.qfrc_bias.copy())
        assert held[1] - held[0] == pytest.approx(expected, abs=1e-10)


def test_servos_that_nobody_knows_are_not_asked_for_a_payload(tmp_path: Path) -> None:
    """A softer servo sags alike."""
    arm = two_links(tmp_path)
    h = hide(arm, ["payload"], seed=3, seconds=30.0, start=START)
    names = {c.name for c in diagnose_servo([h.log], arm, Servo()).causes}
    assert "payload" not in names
    assert "servo_stiffness" in names


def test_a_body_is_proposed_where_one_is_hidden() -> None:
    arm = load_arm("panda", payload=(0.3, 0.0, 0.0, 0.1))
    for causes, expected in ((["payload"], True), ([], False)):
        h = hide(arm, causes, seed=4, seconds=40.0)
        motions = joint_motions(arm, [h.log])
        nominal = nominal_parameters(h.servo, motions)
        found = proposed(arm, motions, nominal, np.ones(len(h.log.t), bool))
        assert (found is not None) is expected
        if found is not None:
            assert h.payload is not None
            low, high = found.parameters["mass_kg"].ci95
            assert low < h.payload[0] < high
            assert found.mass == pytest.approx(h.payload[0], rel=0.3)


@pytest.mark.slow
def test_a_hidden_payload_is_named_and_carried() -> None:
    arm = load_arm("panda")
    h = hide(arm, ["payload"], seed=4, seconds=40.0)
    d = diagnose_servo([h.log], arm, h.servo)
    assert [c.name for c in d.causes] == ["payload"]
    said = d.to_json()["causes"][0]["parameters"]
    assert h.payload is not None
    assert said["mass_kg"]["ci95"][0] < h.payload[0] < said["mass_kg"]["ci95"][1]
    assert len(said["com_m"]["value"]) == 3
    assert d.payload is not None
    assert d.payload.mass == said["mass_kg"]["value"]
    assert (d.extended_rms < 0.5 * d.nominal_rms).any()


@pytest.mark.slow
def test_a_known_payload_comes_on_top_of_the_one_that_was_found(tmp_path: Path) -> None:
    h = hide(load_arm("panda"), ["payload"], seed=4, seconds=40.0)
    diagnose(h.log, "panda", **h.options).save(tmp_path / "out")
    model = tmp_path / "out" / "model.toml"
    assert diagnose(h.log, "panda", nominal=model).causes == ()
    # the model of a robot that was given a tool since then has both
    tool = (0.7, 0.0, 0.0, 0.1)
    more = diagnose(h.log, "panda", nominal=model, payload=tool)
    assert isinstance(more, ServoResult)
    assert more.extension.nominal.payload == tool
    assert [p.cause for p in more.extension.nominal.parts] == ["payload"]
    assert more.causes
