"""Any model under a feedback law, and what is said where it is unstable."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from stiction_envs.plant import steer

PENDULUM = """<mujoco><option timestep="0.001" integrator="Euler"/><worldbody><body>
  <joint name="j" type="hinge" axis="0 1 0" {joint}/><geom size="0.05" pos="0 0 -0.3" mass="1"/>
</body></worldbody><actuator><motor joint="j"/></actuator></mujoco>"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(model, push, steps=400, **options):
    """Angles (N, K) of pendulums from rest at angles of ±0.1 rad under a torque of their speed."""
    start = {"qpos": np.array([[0.1], [-0.1]]), "qvel": np.zeros((2, 1))}
    law = lambda k, batch: push[:, None] * batch.bind("qvel")  # noqa: E731
    return steer(model, start, law, steps, threads=1, **options)[..., 0]


def test_a_law_drives_each_simulation_by_itself():
    """Damping by the law is that of MuJoCo's own, stepped explicitly."""
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(joint=""))
    found = run(model, np.array([-0.2, 0.0]), 1500)
    assert np.isfinite(found).all()
    assert np.abs(found[0, -500:]).max() < 0.3 * np.abs(found[1, -500:]).max()
    # mirrored, the free one swings with its period 2π √((l² + 2 r²/5)/(g l)), as it should
    work, alone = mujoco.MjData(model), []
    work.qpos[:] = -0.1
    for _ in range(1500):
        mujoco.mj_step(model, work)
        alone.append(work.qpos[0])
    np.testing.assert_array_equal(found[1], alone)


def test_an_unstable_one_ends_in_nan(folder):
    """A damping of h c/J > 2 grows in Euler; its neighbour goes on."""
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(joint=""))
    inertia = 0.3**2 + 0.4 * 0.05**2
    found = run(model, np.array([-2.5 * inertia / 1e-3, -0.2]))
    gone = np.isnan(found[0])
    assert gone.any()
    assert np.isfinite(found[1]).all()
    first = int(np.argmax(gone))
    assert gone[first:].all()
    assert np.isfinite(found[0, :first]).all()
    # at h c/J < 2 it holds: the boundary is where theory has it
    assert np.isfinite(run(model, np.array([-1.9 * inertia / 1e-3, -0.2]))).all()


def test_one_that_is_too_fast_has_ended():
    """Before the engine says so: speeds that are no joint's."""
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(joint=""))
    early, late = (
        int(np.isfinite(run(model, np.array([0.5, 0.0]), 2000, fastest=v)[0]).sum())
        for v in (2.0, 50.0)
    )
    assert 0 < early < late
