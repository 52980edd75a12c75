"""MuJoCo and pinocchio read the same arm: M, C, g, J and the flange agree to 1e-9."""

from __future__ import annotations

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


def _disagreement(arm: Arm, count: int) -> dict[str, float]:
    """Largest difference over the states, relative to the quantity's largest entry there."""
    model, data = arm.model(), mujoco.MjData(arm.model())
    other = arm.pinocchio()
    store = other.createData()
    frame = other.getFrameId(arm.end_effector)
    site = model.site(arm.end_effector).id
    jacobian = np.zeros((6, arm.n))
    mass = np.zeros((arm.n, arm.n))
    zero = np.zeros(arm.n)
    worst: dict[str, float] = {}

    def note(what: str, ours: np.ndarray, theirs: np.ndarray, scale: float) -> None:
        error = float(np.abs(ours - theirs).max() / max(scale, np.abs(theirs).max()))
        worst[what] = max(worst.get(what, 0.0), error)

    for q, v, _ in zip(*states(arm, count), strict=True):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)
        bias = data.qfrc_bias.copy()
        data.qvel[:] = 0
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)
        gravity = data.qfrc_bias.copy()
        mujoco.mj_fullM(model, data, mass)
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)

        pin_gravity = pin.computeGeneralizedGravity(other, store, q).copy()
        pin_bias = pin.rnea(other, store, q, v, zero).copy()
        pin_mass = np.triu(pin.crba(other, store, q))
        pin_mass += np.triu(pin_mass, 1).T
        coriolis = pin.computeCoriolisMatrix(other, store, q, v) @ v
        frames = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pin_jacobian = pin.computeFrameJacobian(other, store, q, frame, frames)
        pin.framesForwardKinematics(other, store, q)
        pose = store.oMf[frame]

        note("M", mass, pin_mass, 1e-3)
        note("bias", bias, pin_bias, 1.0)
        note("C qd", bias - gravity, coriolis, 1.0)
        note("g", gravity, pin_gravity, 1.0)
        note("J", jacobian, pin_jacobian, 1.0)
        note("position", data.site_xpos[site], pose.translation, 1.0)
        note("rotation", data.site_xmat[site].reshape(3, 3), pose.rotation, 1.0)
    return worst


@pytest.mark.parametrize("payload", [None, PAYLOAD], ids=["bare", "payload"])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), TILT], ids=["upright", "tilted"])
@pytest.mark.parametrize("name", BUILTIN)
def test_pinocchio_agrees_with_mujoco(name, tilt, payload):
    worst = _disagreement(load_arm(name, payload=payload, tilt=tilt), STATES)
    assert len(worst) == 7
    assert max(worst.values()) < TOLERANCE, worst


@pytest.mark.parametrize("name", ["three.xml", "two.urdf"])
def test_pinocchio_agrees_on_users_arms(tmp_path: Path, name: str):
    worst = _disagreement(load_arm(write_arms(tmp_path) / name, payload=PAYLOAD, tilt=TILT), 200)
    assert max(worst.values()) < TOLERANCE, worst
