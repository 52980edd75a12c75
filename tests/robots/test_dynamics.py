"""MuJoCo and pinocchio read the same arm: M, C, g, J and the flange agree to 1e-9."""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from stiction_envs.robots import BUILTIN, Arm, load_arm
from tests.robots.arms import states, write_arms

STATES = 200
TOLERANCE = 1e-9
PAYLOAD = (1.7, 0.02, -0.03, 0.08)
TILT = (0.2, -0.35)


def _disagreement(arm: Arm) -> dict[str, float]:
    """Largest difference over the states, relative to the quantity's largest entry there."""
    model, other = arm.model(), arm.pinocchio()
    data, store = mujoco.MjData(model), other.createData()
    frame, site = other.getFrameId(arm.end_effector), model.site(arm.end_effector).id
    jacobian, mass = np.zeros((6, arm.n)), np.zeros((arm.n, arm.n))
    worst: dict[str, float] = {}
    for q, v, _ in zip(*states(arm, STATES), strict=True):
        data.qpos[:], data.qvel[:] = q, 0
        mujoco.mj_forward(model, data)
        gravity = data.qfrc_bias.copy()
        data.qvel[:] = v
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)

        pin_mass = np.triu(pin.crba(other, store, q))
        pin_mass += np.triu(pin_mass, 1).T
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pin_jacobian = pin.computeFrameJacobian(other, store, q, frame, axes)
        pin.framesForwardKinematics(other, store, q)
        pose = store.oMf[frame]
        pin_bias = pin.rnea(other, store, q, v, np.zeros(arm.n)).copy()
        pin_gravity = pin.computeGeneralizedGravity(other, store, q).copy()
        coriolis = pin.computeCoriolisMatrix(other, store, q, v) @ v
        for what, ours, theirs, least in (
            ("M", mass, pin_mass, 1e-3),
            ("bias", data.qfrc_bias, pin_bias, 1.0),
            ("C qd", data.qfrc_bias - gravity, coriolis, 1.0),
            ("g", gravity, pin_gravity, 1.0),
            ("J", jacobian, pin_jacobian, 1.0),
            ("position", data.site_xpos[site], pose.translation, 1.0),
            ("rotation", data.site_xmat[site].reshape(3, 3), pose.rotation, 1.0),
        ):
            error = float(np.abs(ours - theirs).max() / max(least, np.abs(theirs).max()))
            worst[what] = max(worst.get(what, 0.0), error)
    return worst


@pytest.mark.parametrize("payload", [None, PAYLOAD], ids=["bare", "payload"])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), TILT], ids=["upright", "tilted"])
@pytest.mark.parametrize("name", [*BUILTIN, "three.xml", "two.urdf"])
def test_pinocchio_agrees_with_mujoco(tmp_path: Path, name, tilt, payload):
    path = write_arms(tmp_path) / name
    worst = _disagreement(load_arm(path if path.exists() else name, payload=payload, tilt=tilt))
    assert max(worst.values()) < TOLERANCE, worst
