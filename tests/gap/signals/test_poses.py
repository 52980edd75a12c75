"""Poses at rest: each is alone, friction scatters them, and gravity's causes are found in them."""

import dataclasses

import numpy as np
import pytest

from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.diagnosis import diagnose_logs
from stiction_envs.gap.signals.rigid_body import gravity_torque, inverse_dynamics
from stiction_envs.measured.logs.reader import JointLog
from tests.gap.small_logs import hidden, panda

BAND = 0.1


def poses(true=None, *, offset: float = 0.0, count: int = 200, seed: int = 0) -> JointLog:
    """Poses of a Panda, the last 20 of them taken twice; friction holds what it likes."""
    arm = panda()
    rng = np.random.default_rng(seed)
    low, high = arm.limits.position.T
    q = low + (high - low) * rng.uniform(0.15, 0.85, (count, 7))
    q = np.vstack([q, q[-20:] + 1e-3 * rng.normal(size=(20, 7))])
    tau = gravity_torque((true or arm).pinocchio(), q)
    tau[:, 2] += offset
    return JointLog(
        source="poses.csv",
        t=np.arange(float(len(q))),
        q=q,
        dq=None,
        tau=tau + BAND * rng.uniform(-1, 1, q.shape),
        static=True,
    )


def test_a_payload_and_an_offset_are_found_in_poses_alone() -> None:
    """Half a kilogram, 5 cm before the flange, and a sensor that is off by 0.8 N·m."""
    found = diagnose_logs([poses(panda(payload=(0.5, 0.0, 0.0, 0.05)), offset=0.8)], "panda")
    by = {c.name: c for c in found.causes}
    assert all(cause_named(name).shown_at_rest for name in by)
    mass = by["payload"].parameters[0]["mass_kg"]
    assert mass.value == pytest.approx(0.5, abs=0.05)
    assert by["torque_offset"].joints == (3,)
    assert by["torque_offset"].parameters[3]["offset_nm"].value == pytest.approx(0.8, abs=0.05)
    assert found.verdict == "explained"


def test_nothing_is_found_in_good_poses() -> None:
    found = diagnose_logs([poses()], "panda")
    assert found.causes == ()
    assert found.verdict == "no discrepancy"


def test_a_joint_that_rests_is_no_evidence() -> None:
    """Joint 3 holds while others move; what it holds creeps by 0.2 N·m: no cause is there."""
    rng = np.random.default_rng(3)
    log = hidden(panda(), lambda q, dq, ddq: 0.8 * np.tanh(dq / 0.002), noise=0.02)
    q = np.array(log.q)
    q[:, 2] = 0.0
    model = panda().pinocchio()
    dq = np.gradient(q, log.t, axis=0)
    ddq = np.gradient(dq, log.t, axis=0)
    tau = inverse_dynamics(model, q, dq, ddq) + 0.8 * np.tanh(dq / 0.002)
    tau[:, 2] += np.interp(log.t, np.arange(16.0), 0.2 * rng.normal(size=16))
    still = dataclasses.replace(log, q=q, tau=tau + 0.02 * rng.normal(size=q.shape))
    found = diagnose_logs([still], "panda")
    assert [(c.name, c.joints) for c in found.causes] == [("coulomb_friction", (1, 2, 4, 5, 6, 7))]
    assert found.verdict == "explained"


@pytest.mark.slow
def test_poses_beside_a_log() -> None:
    """The log shows friction, the poses the payload; one call takes both."""
    true = panda(payload=(1.0, 0.0, 0.0, 0.05))
    log = hidden(panda(), lambda q, dq, ddq: 0.8 * np.tanh(dq / 0.002), true=true, noise=0.02)
    found = diagnose_logs([log, poses(true)], "panda")
    assert {"payload", "coulomb_friction"} <= {c.name for c in found.causes}
