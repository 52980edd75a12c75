"""The plant: limit cases of the physics it steps. Its bits: test_determinism.py."""

import re
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from stiction_envs.errors import ExperimentError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import (
    Configuration,
    Job,
    configurations,
    load_protocol,
)
from stiction_envs.friction.model import StickingModel, build
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.plant import SLOW_STEPS, Plant
from stiction_envs.plant import plant as plant_module
from stiction_envs.plant.any_model import steer
from stiction_envs.robots import load_arm
from tests.friction.gyro import J_A, pendulum, sticking
from tests.refusal import refusal

DT = 1e-3
ONE = np.arange(1)


@cache
def panda() -> StickingModel:
    return build(load_arm("panda"))


def quiet(model: StickingModel, **changes: float) -> FrictionParameters:
    """Parameters of the arm without bias and ripple."""
    names = ("offset", "gravity_error", "ripple_amplitude")
    p = model.parameters
    changes = dict.fromkeys(names, 0.0) | changes
    return p.replace(**{k: np.full_like(getattr(p, k), v) for k, v in changes.items()})


def poses(n: int = 4) -> np.ndarray:
    low, high = panda().arm.limits.position.T
    return np.random.default_rng(8).uniform(low + 0.2, high - 0.2, (n, 7))


def posed(parameters: FrictionParameters | None = None) -> Plant:
    """Return four arms at rest in `poses`."""
    plant = Plant(panda(), 4, parameters=parameters)
    plant.reset(np.arange(4), poses())
    return plant


def test_rest_stays_at_rest():
    """Without bias and ripple nothing acts on an arm at rest, in any pose."""
    out = posed(quiet(panda())).run(np.zeros((4, 1000, 7)))
    assert np.abs(out - poses()[:, None]).max() < 1e-10


def test_arm_as_shipped_comes_to_rest():
    """The arm's bias is under its stiction, so bias and ripple only bend the bristles."""
    plant = posed()
    assert np.all(np.abs(plant.offset) < 0.8 * plant.stiction)
    plant.run(np.zeros((4, 15_000, 7)))  # the springs of joints 1-4 ring, the bristles settle
    out = plant.run(np.zeros((4, 1000, 7)))
    assert np.ptp(out, axis=1).max() < 1e-10
    assert np.abs(out[:, -1] - poses()).max() < 0.01


def test_gravity_compensation_holds_an_arm_without_friction():
    smooth = quiet(panda(), stiction=1e-6, viscous=0.0, load_coefficient=0.0)
    out = posed(smooth).run(np.zeros((4, 500, 7)))
    assert np.abs(out - poses()[:, None]).max() < 1e-9
    # one per cent of error in it, and it falls
    wrong = smooth.replace(gravity_error=np.full(7, 0.01), load_high=np.full(7, np.inf))
    assert np.abs(posed(wrong).run(np.zeros((4, 500, 7))) - poses()[:, None]).max() > 0.01


def test_gravity_error_and_offset_are_torques_on_the_link():
    """offset + gravity_error · g(q) is the motor torque that balances the joint."""
    changes = {"offset": [0.0, 0.3], "gravity_error": [0.0, 0.05], "load_high": 1e9}
    plant = Plant(sticking(pendulum(), stiction=1e-6, **changes), 1, threads=1)
    plant.reset(ONE, [[0.0, 0.8]])
    # hinge about x, mass above it: gravity pulls towards larger q, so g(q) is negative
    g = -2.0 * 9.81 * 0.5 * np.sin(0.8)
    assert plant.offset[0, 1] == pytest.approx(0.3 + 0.05 * g)
    balance = np.tile([0.0, 0.3 + 0.05 * g], (1, 20, 1))
    assert np.abs(plant.run(balance)[0, :, 1] - 0.8).max() < 1e-9
    assert np.abs(plant.run(np.zeros((1, 100, 2)))[0, -1, 1] - 0.8) > 1e-4


def test_without_friction_a_joint_is_torque_over_inertia():
    plant = Plant(sticking(stiction=1e-6), 1, threads=1)
    q = plant.run(np.tile([0.7, 0.0], (1, 500, 1)))[0]
    acceleration = np.diff(q[:, 0], 2) / DT**2
    np.testing.assert_allclose(acceleration[10:], 0.7 / (J_A + 0.05), rtol=1e-4)
    assert q[-1, 0] == pytest.approx(0.7 / (J_A + 0.05) * 0.5**2 / 2, rel=0.01)
    assert np.abs(q[:, 1]).max() == 0.0


def total_energy(plant: Plant) -> np.ndarray:
    """(N,) kinetic + spring + bristle energy [J]; gravity is compensated."""
    model, data = plant.sticking.model, mujoco.MjData(plant.sticking.model)
    qpos, qvel = plant.batch.bind("qpos"), plant.batch.bind("qvel")
    sigma0 = plant.sticking.parameters.bristle_stiffness
    out = []
    full = np.zeros((model.nv, model.nv))
    for i in range(plant.nsim):
        data.qpos[:], data.qvel[:] = qpos[i], qvel[i]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        spring = model.jnt_stiffness @ (qpos[i] - model.qpos_spring) ** 2
        bristle = sigma0 @ plant.bristle[i] ** 2
        out.append(0.5 * (qvel[i] @ full @ qvel[i] + spring + bristle))
    return np.array(out)


def test_energy_never_grows_without_input():
    """A pushed arm, let go, only loses energy until it stands."""
    plant = posed(quiet(panda()))
    push = np.random.default_rng(1).uniform(-1, 1, (4, 1, 7)) * np.array([15, 15, 15, 15, 3, 3, 3])
    plant.run(np.tile(push, (1, 150, 1)))
    energy = [total_energy(plant)]
    for _ in range(250):
        plant.run(np.zeros((4, 20, 7)))
        energy.append(total_energy(plant))
    e = np.array(energy)
    assert e[0].min() > 0.05
    assert np.all(np.diff(e, axis=0) < 1e-6 * e[0])
    assert np.all(e[-1] < 1e-2 * e[0])


def test_bearing_load_is_the_moment_across_the_axis():
    """A joint without gravity torque carries |r × w| without its part along the axis, any tilt."""
    model = build(load_arm("iiwa7"))
    assert model.bearing.tolist() == [True, False, False, False, False, False, True]
    low, high = model.arm.limits.position.T
    q = np.random.default_rng(4).uniform(low, high, (6, 7))
    plant = Plant(model, 6)
    plant.reset(np.arange(6), q)
    rigid = model.arm.model()
    data = mujoco.MjData(rigid)
    for i in range(6):
        data.qpos[:] = q[i]
        mujoco.mj_forward(rigid, data)
        for joint in (0, 6):
            body = rigid.jnt_bodyid[joint]
            weight = rigid.body_subtreemass[body] * rigid.opt.gravity
            moment = np.cross(data.subtree_com[body] - data.xanchor[joint], weight)
            axis = data.xaxis[joint]
            across = np.linalg.norm(moment - (moment @ axis) * axis)
            assert plant.load[0][i, joint] == pytest.approx(across, rel=1e-9, abs=1e-12)


def test_warm_up_lowers_friction_over_time():
    """F(t) = F (1 + w e^(−t/T)), refreshed every 20 ms."""
    plant = Plant(sticking(warm_up_friction=0.5, warm_up_time=0.4), 1, threads=1)
    assert plant.stiction[0, 0] == pytest.approx(0.6 * 1.5)
    for k in range(1, 5):
        plant.run(np.zeros((1, 200, 2)))
        last = 0.2 * k - SLOW_STEPS * DT
        assert plant.stiction[0, 0] == pytest.approx(0.6 * (1 + 0.5 * np.exp(-last / 0.4)))


@pytest.mark.parametrize(("q0", "phase"), [(-0.31, 1.0), (0.05, 0.0)])
def test_ripple_is_a_sine_of_the_angle(q0, phase):
    """The motor feels A sin(Nq + φ); seen as the acceleration of a joint without friction."""
    model = sticking(stiction=1e-6, ripple_amplitude=0.2, ripple_periods=20.0, ripple_phase=phase)
    plant = Plant(model, 1, threads=1)
    plant.reset(ONE, [[q0, 0.0]])
    plant.run(np.zeros((1, 1, 2)))
    torque = plant.velocity[0, 0] / DT * (J_A + 0.05)
    assert torque == pytest.approx(0.2 * np.sin(20.0 * q0 + phase), abs=1e-5)


def test_errors(tmp_path, monkeypatch):
    refusal(lambda: Plant(panda(), 0), "number of simulations 0")
    refusal(lambda: Plant(panda(), 1, parameters=load_friction("panda").rigid()), "elastic")
    plant = Plant(panda(), 2)
    for bad in (3.0, np.nan, -np.inf):
        q = np.tile(panda().arm.rest, (2, 1))
        q[1, 4] = bad
        refusal(lambda q=q: plant.reset(np.arange(2), q), "joint 5: start angle")
    # a simulation that the engine gives up on must not look like a joint that stands
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log there
    torque = np.zeros((2, 40, 7))
    torque[1, :, 3] = 1e9
    with pytest.raises(ExperimentError, match="simulation 1 stopped by the engine: mjWARN_BADQACC"):
        plant.run(torque)


def first_torques(
    jobs: list[Job], *, timestep: float = 1e-3, ramp_rate: float = 0.07
) -> np.ndarray:
    protocol = load_protocol("panda").replace(ramp_rate=ramp_rate)
    bench = SingleJointExperiment("panda", scatter=False, timestep=timestep, protocol=protocol)
    found = {m.job: m.mean for m in bench.run(jobs, iterations=1)}
    return np.array([found[j] for j in jobs])


@pytest.mark.slow
def test_refined_step_gives_the_same_base_torque():
    """1 ms against 0.05 ms, wrist and elastic joint: base torques within 2 %, dithered ones too."""
    wrist, elastic = Configuration(7, "load", "+"), Configuration(4, "no_load", "-")
    jobs = [Job(wrist), Job(elastic), Job(wrist, 15.0, 0.3), Job(elastic, 30.0, 0.5)]
    coarse, fine = first_torques(jobs), first_torques(jobs, timestep=5e-5)
    np.testing.assert_allclose(coarse, fine, rtol=0.02)
    assert np.all(np.abs(coarse[2:]) < 0.99 * np.abs(coarse[:2]))  # the dither does something


@pytest.mark.slow
def test_slow_updates_are_fast_enough(monkeypatch):
    """Load and bias every `SLOW_STEPS` or every step: base torques differ by less than 0.2 %.

    A fast ramp moves the joint faster, so this is the harder case.
    """
    jobs = [Job(c) for c in configurations(7, [2, 4])]
    usual = first_torques(jobs, ramp_rate=0.2)
    monkeypatch.setattr(plant_module, "SLOW_STEPS", 1)
    np.testing.assert_allclose(usual, first_torques(jobs, ramp_rate=0.2), rtol=2e-3)


def test_physics_is_stepped_in_the_plant_only():
    """House rule: no file outside of its room calls the engine's stepping functions.

    Only `hidden` may: its logs stand in for another robot, and another's simulator.
    """
    package = Path(plant_module.__file__).parents[1]
    stepping = re.compile(r"mj_step|\.rollout\(|batch\.step\(")
    sources = {
        p.relative_to(package).as_posix(): p.read_text("utf-8") for p in package.rglob("*.py")
    }
    found = {name.split("/")[0] for name, text in sources.items() if stepping.search(text)}
    assert found - {"hidden"} == {"plant"}


PENDULUM = mujoco.MjModel.from_xml_string("""<mujoco>
<option timestep="0.001" integrator="Euler"/><worldbody><body>
  <joint name="j" type="hinge" axis="0 1 0"/><geom size="0.05" pos="0 0 -0.3" mass="1"/>
</body></worldbody><actuator><motor joint="j"/></actuator></mujoco>""")


def steered(push, steps=400, **options):
    """Angles (N, K) of pendulums from rest at angles of ±0.1 rad under a torque of their speed."""
    start = {"qpos": np.array([[0.1], [-0.1]]), "qvel": np.zeros((2, 1))}
    law = lambda k, batch: push[:, None] * batch.bind("qvel")  # noqa: E731
    return steer(PENDULUM, start, law, steps, threads=1, **options)[..., 0]


def test_a_law_drives_each_simulation_by_itself():
    """Damping by the law is that of MuJoCo's own, stepped explicitly."""
    found = steered(np.array([-0.2, 0.0]), 1500)
    assert np.isfinite(found).all()
    assert np.abs(found[0, -500:]).max() < 0.3 * np.abs(found[1, -500:]).max()
    # mirrored, the free one swings with its period 2π √((l² + 2 r²/5)/(g l)), as it should
    work, alone = mujoco.MjData(PENDULUM), []
    work.qpos[:] = -0.1
    for _ in range(1500):
        mujoco.mj_step(PENDULUM, work)
        alone.append(work.qpos[0])
    np.testing.assert_array_equal(found[1], alone)


def test_an_unstable_one_ends_in_nan(tmp_path, monkeypatch):
    """A damping of h c/J > 2 grows in Euler; its neighbour goes on."""
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log there
    inertia = 0.3**2 + 0.4 * 0.05**2
    found = steered(np.array([-2.5 * inertia / 1e-3, -0.2]))
    gone = np.isnan(found[0])
    assert gone.any()
    assert np.isfinite(found[1]).all()
    first = int(np.argmax(gone))
    assert gone[first:].all()
    assert np.isfinite(found[0, :first]).all()
    # at h c/J < 2 it holds: the boundary is where theory has it
    assert np.isfinite(steered(np.array([-1.9 * inertia / 1e-3, -0.2]))).all()
