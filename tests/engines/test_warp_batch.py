"""The plant on MuJoCo Warp is the plant on MuJoCo, but for float32 (extra warp)."""

from __future__ import annotations

from copy import copy
from functools import cache

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from stiction_envs.envs import tiles
from stiction_envs.errors import ExperimentError, StictionError
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.model import (
    BRISTLE_STIFFNESS,
    COULOMB,
    STICTION,
    STRIBECK,
    StickingModel,
    build,
)
from stiction_envs.friction.parameters import QUANTITIES, FrictionParameters, load_friction
from stiction_envs.plant import Plant
from stiction_envs.robots import load_arm

pytest.importorskip("mujoco_warp")
import warp as wp

from stiction_envs.engines import warp_batch

pytestmark = pytest.mark.slow  # the kernels load for seconds, and compile for a minute at first
ENGINES = ("mujoco", "warp")
N, K = 7, 300
DT = 1e-3


@cache
def panda() -> StickingModel:
    """Elastic joints, rigid ones, friction that differs by direction."""
    arm = load_arm("panda")
    p = load_friction("panda", 7)
    down = {
        name: getattr(p, name) * [1.0, factor]
        for name, factor in (
            *(("stiction", 1.3), ("coulomb_ratio", 0.8)),
            *(("stribeck_velocity", 2.0), ("viscous", 1.5)),
        )
    }
    assert 0 < p.elastic.sum() < 7
    return build(arm, p.replace(**down))


@cache
def poses() -> np.ndarray:
    low, high = panda().arm.limits.position.T
    return np.random.default_rng(3).uniform(low + 0.4, high - 0.4, (N, 7))


def there_and_back() -> np.ndarray:
    """Torques (N, K, 7) that break joints loose, turn them round and shake them [N·m]."""
    t = np.arange(K)[None, :, None] * DT
    size = np.linspace(0.5, 1.5, N)[:, None, None] * panda().parameters.stiction.max(axis=1)
    return 3 * size * np.sin(2 * np.pi * 5 * t) + 0.3 * np.sin(2 * np.pi * 40 * t)


def moved(
    engine: str, parameters: FrictionParameters | None = None, model: StickingModel | None = None
) -> np.ndarray:
    """Angles (N, K, 7) of arms under `there_and_back` [rad]."""
    plant = Plant(panda() if model is None else model, N, parameters=parameters, engine=engine)
    plant.reset(np.arange(N), poses())
    return plant.run(there_and_back())


@cache
def usual(engine: str) -> np.ndarray:
    return moved(engine)


def apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max())


def test_arms_move_as_on_mujoco():
    assert np.ptp(usual("mujoco"), axis=1).min() > 1e-4
    assert apart(usual("mujoco"), usual("warp")) < 1e-6


CHANGED = {
    **{name: 1.3 for name in QUANTITIES},
    "coulomb_ratio": 0.8,
    "bristle_stiffness": 0.7,
    "bristle_damping_ratio": 0.9,
    "load_low": 5.0,
    "load_high": 2.0,
    "ripple_amplitude": 0.2,
    "ripple_periods": 7.0,
    "offset": 0.3,
    "gravity_error": 0.05,
    "warm_up_friction": 0.5,
    "warm_up_viscous": 0.5,
    "warm_up_time": 0.1,
}
"""A factor of each quantity; of those that are 0 on some joint, or are times, the value itself."""
VALUES = {"load_low", "load_high", *list(CHANGED)[-8:]} & set(QUANTITIES)


@pytest.mark.parametrize("name", QUANTITIES)
def test_every_quantity_acts_as_on_mujoco(name):
    """Each changes the motion, and by the same on both."""
    base = panda().parameters.replace(ripple_amplitude=np.full(7, 0.1))
    base = base.replace(warm_up_friction=np.full(7, 0.2), warm_up_viscous=np.full(7, 0.2))
    if name.startswith("load"):
        base = base.replace(load_low=np.zeros(7), load_high=np.full(7, 20.0))
        base = base.replace(load_coefficient=np.full(7, 0.03))
    own = getattr(base, name)
    value = np.full_like(own, CHANGED[name]) if name in VALUES else own * CHANGED[name]
    if name == "joint_stiffness":
        value = np.where(base.elastic, value, np.inf)
    if name == "ripple_phase":
        value = own + 1.3
    changed = base.replace(**{name: value})
    there = [moved(engine, changed) for engine in ENGINES]
    assert apart(*there) < 2e-6
    assert apart(there[0], moved("mujoco", base)) > 1e-4


def test_servos_hold_joints_as_on_mujoco():
    out = []
    for engine in ENGINES:
        plant = Plant(panda(), N, engine=engine)
        plant.reset(np.arange(N), poses())
        stiffness = np.tile(8 * panda().arm.limits.torque, (N, 1))
        plant.set_servo(np.arange(N), stiffness, 0.1 * stiffness, poses())
        goal = poses()[:, None] + 0.2 * np.linspace(0, 1, K)[None, :, None]
        out.append(plant.run(there_and_back(), setpoint=goal))
    assert apart(*out) < 1e-6
    assert apart(out[0], usual("mujoco")) > 0.01


def test_limits_stop_joints_as_on_mujoco():
    limits = panda().arm.limits.position
    out = []
    for engine in ENGINES:
        plant = Plant(panda(), N, engine=engine)
        plant.reset(np.arange(N), np.tile(limits[:, 1] - 0.01, (N, 1)))
        out.append(plant.run(np.abs(there_and_back())))
    assert apart(*out) < 1e-4
    rigid = ~panda().parameters.elastic
    assert np.all(out[0][..., rigid].max(axis=(0, 1)) > limits[rigid, 1] - 0.005)
    assert np.all(out[0][..., rigid].max(axis=(0, 1)) < limits[rigid, 1] + 0.05)


def test_physics_steps_shorter_than_a_control_step():
    short = build(load_arm("panda"), timestep=1e-3 / 3)
    assert apart(moved("mujoco", model=short), moved("warp", model=short)) < 1e-6


def test_a_slow_joint_is_not_lost_in_float32():
    """Under a ramp of 1 mN·m/s a joint bends its bristle by less than half of a last digit a step.

    Summed in float32 the angle would stay where it was.
    """
    out = []
    for engine in ENGINES:
        plant = Plant(panda(), 1, engine=engine)
        plant.reset(np.arange(1), panda().arm.rest[None])
        plant.run(np.zeros((1, 2000, 7)))
        torque = np.zeros((1, 1500, 7))
        torque[0, :, 3] = 1e-3 * DT * np.arange(1500)
        q = plant.run(torque, joint=np.array([3]))[0]
        out.append(q - q[0])
    step = np.abs(np.diff(out[0])).max()
    assert step < 0.5 * np.spacing(np.float32(abs(panda().arm.rest[3])))
    assert apart(*out) < 0.02 * np.abs(out[0]).max()


@pytest.mark.parametrize("speed", [0.0, 1e-12, -1e-9, 3e-6, -0.02, 5.0])
def test_bristles_bend_at_any_speed(speed):
    """By the exact solution of ż = v − σ0|v|z/g(v) over a step, at constant speed."""
    stiffness, coulomb, stiction, stribeck, z = 700.0, 0.4, 0.5, 0.01, 3e-4
    law, dynamics = np.zeros((1, 1, 10)), np.zeros((1, 1, 10))
    law[..., [COULOMB, STICTION, STRIBECK]] = coulomb, stiction, stribeck
    dynamics[..., BRISTLE_STIFFNESS] = stiffness
    bristle, act = wp.array([[z]], dtype=wp.float64), wp.zeros((1, 1), dtype=wp.float32)
    here = wp.zeros(1, dtype=wp.int32)
    parameters = [wp.array(x, dtype=warp_batch.VECTOR) for x in (dynamics, law)]
    velocity = wp.array([[speed]], dtype=wp.float32)
    inputs = [DT, here, here, *parameters, velocity]
    wp.launch(warp_batch.bend_bristles, dim=(1, 1), inputs=inputs, outputs=[bristle, act])
    v = float(np.float32(speed))
    rate = stiffness * abs(v) / (coulomb + (stiction - coulomb) * np.exp(-((v / stribeck) ** 2)))
    moved = v * (-np.expm1(-rate * DT) / rate if rate else DT) + z * np.expm1(-rate * DT)
    assert bristle.numpy()[0, 0] - z == pytest.approx(moved, rel=2e-5, abs=1e-19)
    assert act.numpy()[0, 0] == np.float32(bristle.numpy()[0, 0])


# ---- the same bits -------------------------------------------------------------------------------


def started(rows: np.ndarray) -> Plant:
    plant = Plant(panda(), len(rows), engine="warp")
    plant.reset(np.arange(len(rows)), poses()[rows])
    return plant


@pytest.mark.parametrize("rows", [[0], [6, 2], list(range(N))[::-1]], ids=["1", "2", "7"])
def test_same_bits_in_any_batch(rows):
    out = started(np.array(rows)).run(there_and_back()[rows])
    assert out.tobytes() == usual("warp")[rows].tobytes()


def test_same_bits_in_any_blocks_and_beside_others_that_move():
    plant, ids = started(np.arange(N)), np.array([1, 4])
    torque = there_and_back()
    plant.run(torque[[0, 5], :40], np.array([0, 5]))
    parts = [plant.run(torque[ids, a:b], ids) for a, b in ((0, 7), (7, 130), (130, K))]
    assert np.concatenate(parts, axis=1).tobytes() == usual("warp")[ids].tobytes()
    assert np.array_equal(plant.position[3], poses()[3])


@pytest.mark.parametrize("experiment", ["sje", "gte"])
def test_same_bits_in_any_tiles_of_any_thread(experiment, monkeypatch):
    def steps(arms: int) -> list[np.ndarray]:
        monkeypatch.setattr(tiles, "ON_DEVICE", arms)
        name = f"stiction_envs:Panda{experiment.upper()}-v0"
        env = gym.make_vec(name, num_envs=4, engine="warp", threads=2)
        cores = env.unwrapped.tiles.cores
        assert len(cores) == 4 // arms
        assert cores[0].num_envs == (2 * arms if experiment == "sje" else arms), "starts wait"
        space, out = env.single_action_space, [env.reset(seed=3)[0]]
        for k in range(3):
            share = np.random.default_rng(k).uniform(0, 0.5, (4, *space.shape))
            action = space.low + share * (space.high - space.low)
            out += env.step(action.astype(np.float32))[:2]
        return out

    assert all(a.tobytes() == b.tobytes() for a, b in zip(steps(4), steps(2), strict=True))


def test_gravity_is_left_out_only_where_all_weight_is_compensated():
    model = copy(panda().model)
    without = mujoco.mjtDisableBit.mjDSBL_GRAVITY
    assert warp_batch._weightless(model).opt.disableflags & without
    assert not model.opt.disableflags & without
    model.body_gravcomp[3] = 0.9
    assert warp_batch._weightless(model) is model


# ---- what goes wrong -----------------------------------------------------------------------------


def test_a_simulation_that_goes_wrong_is_named():
    torque = np.zeros((N, 60, 7))
    torque[2] = np.nan
    with pytest.raises(ExperimentError, match="simulation 2 stopped by the engine"):
        started(np.arange(N)).run(torque)


def test_other_joints_are_refused():
    ball = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint type='ball'/><geom size='1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(StictionError, match="hinges and slides only"):
        warp_batch.WarpBatch(ball, 1)


# ---- experiments and environments ----------------------------------------------------------------


@pytest.mark.parametrize("robot", ["panda", "iiwa7"])
def test_breakaway_torques_are_mujocos(robot):
    """Within a per cent; measured 0 on the Panda, 4e-7 on the iiwa: benchmarks/engines/warp.md."""
    found = []
    for engine in ENGINES:
        e = SingleJointExperiment(robot, scatter=False, engine=engine)
        jobs = e.jobs([6, 7], loads=("load",))
        found.append({m.job: m.mean for m in e.run(jobs, iterations=1)})
    for job, tau in found[0].items():
        assert found[1][job] == pytest.approx(tau, rel=0.01)


@pytest.mark.parametrize("name", ["PandaSJE", "IiwaSJE", "PandaGTE", "IiwaGTE"])
def test_observations_and_rewards_are_mujocos(name):
    kept = []
    for engine in ENGINES:
        env = gym.make_vec(f"stiction_envs:{name}-v0", num_envs=2, engine=engine)
        seen, rewards = [env.reset(seed=0)[0]], []
        space = env.single_action_space
        for k in range(8):
            share = np.random.default_rng(k).uniform(0, 0.6, (2, *space.shape))
            observation, reward, *_ = env.step(
                (space.low + share * (space.high - space.low)).astype(np.float32)
            )
            seen.append(observation)
            rewards.append(reward)
        assert len(env.unwrapped.tiles.cores) == 1
        kept.append((np.array(seen), np.array(rewards)))
    (seen, rewards), (seen_w, rewards_w) = kept
    assert apart(seen, seen_w) < 1e-3
    assert apart(rewards, rewards_w) < 1e-3
    assert np.abs(rewards).max() > 1e-3
