"""The GTE environment: iterations, observation, paths; see `test_environments`."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

from stiction_envs.control.impedance import ImpedanceSettings
from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.experiments.gte import undithered as gte_base
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import Measures
from stiction_envs.experiments.gte.protocol import Case, pose_error
from stiction_envs.experiments.gte.random_paths import random_paths
from stiction_envs.friction.parameters import load_friction
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.robots import Arm, load_arm
from tests.envs.helpers import (
    GTE,
    IIWA_GTE,
    PANDA_GTE,
    TRIANGLE,
    episode,
    make_gte,
    mild,
    quiet,
    sprint,
)

QUIET = {"power_weight": 0.0, "torque_rate_weight": 0.0, "shaking_weight": 0.0}


def shaken(env: gym.Env, share: float = 0.3) -> np.ndarray:
    """Return an action that dithers all joints but the third, as float64: no table is float32."""
    action = quiet(env).astype(float)
    action[:7] = share * env.action_space.high[:7]
    action[7:] = [50, 30, 30, 50, 15, 15, 15]
    action[2] = 0.0
    return action


def check_reproduction(env: gym.Env, robot: str | Arm, case: Case, **experiment) -> None:
    """Compare the env's iterations 0 and 2 of a case, shaken, with the experiment's bit for bit."""
    action = shaken(env)
    a, f = np.split(action, 2)
    rows = tuple(AmplitudeRow(j + 1, f[j], a[j]) for j in range(len(a)) if a[j] > 0)
    bench = GeneratedTrajectoryExperiment(robot, **experiment)
    (run,) = bench.run([dataclasses.replace(case, dither=rows)], iterations=3)
    measures = Measures(run)
    recorder, kept = env.unwrapped.core.recorder, []
    advance = recorder._sampler.advance
    recorder._sampler.advance = lambda: kept.append(advance()) or kept[-1]
    for k in (0, 2):
        options = {"trajectory": case.trajectory, "stiffness": case.stiffness, "iteration": k}
        kept.clear()
        final = episode(env, action, seed=11, options=options)[-1][4]
        position = np.concatenate([poses[0, 0, :, :3] for poses, _ in kept])
        error = np.concatenate([pose_error(*poses)[0] for poses, _ in kept])
        # the run ends with its slowest iteration, the episode with a whole step
        count = min(len(position), len(run.time))
        assert abs(len(position) - len(run.time)) < 60
        assert np.array_equal(position[:count], run.actual[k, :count, :3])
        assert np.array_equal(error[:count], run.error[k, :count])
        assert np.array_equal(final["error"], measures.window_sum[k])
        assert final["duration"] == measures.duration[k]
        assert final["shaking"] == measures.shaking[k]
        assert final["error_left"] == pytest.approx(measures.left[k].mean(axis=0), rel=1e-14)


def test_a_constant_action_is_the_experiment_bit_for_bit():
    """`stiction gte` with the same scatter key runs the same path, with the same numbers."""
    case = Case(trajectory="triangle", stiffness=(200, 20, 0))
    check_reproduction(gym.make(PANDA_GTE), "panda", case)


def test_so_it_is_on_the_held_controller_with_compensation_and_another_seed():
    """Undithered runs are compensated as well, so that a reward of −1 still is no dither.

    The arm has a payload that its controller does not know.
    """
    tool, payload, unloaded = (0.0, 0.0, 0.1), (1.0, 0.0, 0.0, 0.05), load_arm("iiwa7")
    more = {"scatter_seed": 3, "control_interval_s": 0.04}
    more |= {"payload": payload, "controller_model": unloaded}
    env = make_gte(IIWA_GTE, compensation="push", tool=tool, **more)
    case = Case(
        trajectory="pentagon",
        stiffness=(400, 40, 5),
        compensation=env.unwrapped.core.compensation,
    )
    loaded, options = load_arm("iiwa7", payload=payload), {"motion": sprint(), "tool": tool}
    check_reproduction(env, loaded, case, seed=3, controller_model=unloaded, **options)
    options = {"trajectory": case.trajectory, "stiffness": case.stiffness}
    bases = [
        episode(e, quiet(e), seed=1, options=options)[-1][4]["undithered_error"]
        for e in (env, make_gte(IIWA_GTE, tool=tool, **more))
    ]
    assert not np.array_equal(*bases)


def test_seeds_draw_every_option():
    env = GTE.make_batch(16)
    _, infos = env.reset(seed=0)
    cases = {(t, *k) for t, k in zip(infos["trajectory"], infos["stiffness"], strict=True)}
    k = ((200.0, 20.0, 0.0), (400.0, 40.0, 0.0))
    assert cases == {(t, *x) for t in ("triangle", "pentagon") for x in k}


def test_observations_mean_what_they_are_called(panda):
    core, names = panda.unwrapped.core, panda.unwrapped.observation_names
    observation, _ = panda.reset(
        seed=1, options={"trajectory": "pentagon", "stiffness": (200, 40, 0)}
    )
    see = dict(zip(names, observation, strict=True))
    assert see["translational"] == 0.5
    assert see["rotational"] == 1
    path = core.path_points(0)
    start = core.rig.end_effector.position[0].copy()
    assert [see[f"goal_{k}"] for k in "xyz"] == pytest.approx(path[1] - start, abs=1e-6)
    assert [see[f"onward_{k}"] for k in "xyz"] == pytest.approx(path[2] - path[1], abs=1e-6)
    assert see["goals_left"] == 5
    assert see["error_x"] == see["reference_x"] == 0
    assert see["remaining"] == pytest.approx(float(core.rig.sequencer.movement.duration[0]))
    observation, _, _, _, info = panda.step(mild(panda, 6, share=0.25))
    see = dict(zip(names, observation, strict=True))
    assert see["amplitude_6"] == pytest.approx(-0.5)
    assert see["remaining"] == pytest.approx(float(core.rig.sequencer.movement.duration[0]) - 0.2)
    x, _, velocity, _ = core.rig.sequencer.reference(0.2)
    error = core.rig.end_effector.position[0] - x[0]
    assert [see[f"error_{k}"] for k in "xyz"] == pytest.approx(error / 0.04, rel=1e-5)
    assert [see[f"reference_{k}"] for k in "xyz"] == pytest.approx(velocity[0] / 0.5, rel=1e-5)
    assert info["goals_reached"] == 0
    while info["goals_reached"] < 4:
        observation, _, _, _, info = panda.step(quiet(panda))
    see = dict(zip(names, observation, strict=True))
    here = core.rig.end_effector.position[0]
    assert [see[f"goal_{k}"] for k in "xyz"] == pytest.approx(path[5] - here, abs=1e-6)
    assert [see[f"onward_{k}"] for k in "xyz"] == [0, 0, 0], "the last"
    assert see["goals_left"] == 1


def test_observed_torque_is_the_impedance_laws_without_dither(panda):
    """Jᵀ(−K e − D J q̇) over the stiction, however strong the dither; 0 after a reset."""
    core, names = panda.unwrapped.core, np.array(panda.unwrapped.observation_names)
    mine = np.char.startswith(names, "torque")
    assert mine.sum() == 7
    observation, _ = panda.reset(seed=1, options=TRIANGLE)
    assert not observation[mine].any()
    for _ in range(3):
        observation, *_ = panda.step(shaken(panda))
    controller, jacobian = core.rig.controller, core.rig.end_effector.jacobian[0]
    # the state is that of the last cycle, 1 ms ago
    expected = jacobian.T @ (controller.arrays.gain[0] @ controller.arrays.state[0])
    assert np.abs(core.rig.dither_torque[0]).max() > 0.1
    assert observation[mine] * core.stiction == pytest.approx(expected, abs=0.02)
    assert np.abs(expected).max() > 0.5
    observation, _ = panda.reset(seed=2, options=TRIANGLE)
    assert not observation[mine].any(), "nothing is left of the episode before"


@pytest.mark.parametrize("arguments", [{"threads": 1}, {"threads": 2}, {"sensing": "robot"}])
def test_an_episode_that_is_over_is_not_stepped(arguments):
    """The other arms of the batch go on; a reset restarts the ended arm."""
    env = GTE.make_batch(3, fixed_options=TRIANGLE, max_episode_steps=2, **arguments)
    action = np.tile(quiet(env.core), (3, 1))
    env.reset(seed=1)
    env.step(action)
    env.reset(options={"reset_mask": np.array([True, False, False])})
    assert env.step(action)[3].tolist() == [False, True, True]
    angles = env.core.rig.plant.state[0]
    angles[1] = np.nan
    *_, truncated, _ = env.step(action)
    assert truncated.tolist() == [True, False, False]
    assert np.isfinite(angles).all(), "arms 2 and 3 have begun again"
    angles[0] = np.nan
    before = angles.copy()
    env.batches.step(np.array([1, 2]), action[1:])
    assert np.array_equal(angles[0], before[0], equal_nan=True)
    assert not (angles[1:] == before[1:]).all()


def test_what_an_undithered_run_depends_on():
    p = load_friction("panda")
    of = GeneratedTrajectoryExperiment
    usual = of("panda")
    others = [
        of("iiwa7"),
        of("panda", scatter=False),
        of("panda", seed=1),
        of("panda", friction=p.replace(stiction=1.2 * p.stiction)),
        of("panda", start=[0.1, *usual.start[1:]]),
        of("panda", tool=(0.0, 0.0, 0.1034)),
        of("panda", settings=ImpedanceSettings(damping_ratio=[1, 1, 1, 1, 1, 0.9])),
        of("panda", motion=MotionLimits(patience=2.0)),
        of(load_arm("panda", payload=(1.0, 0.0, 0.0, 0.05))),
        of("panda", controller_model=load_arm("panda", payload=(1.0, 0.0, 0.0, 0.05))),
    ]
    assert len({gte_base.fingerprint(e) for e in [usual, *others]}) == 1 + len(others)
    assert gte_base.fingerprint(of("panda")) == gte_base.fingerprint(usual)


# ---- random paths --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def few_paths():
    """Draws from three random paths."""
    return make_gte(random_paths=3)


def test_a_numbered_path_is_what_the_arm_follows(few_paths):
    _, info = few_paths.reset(seed=1, options={"path": 101})
    core, e = few_paths.unwrapped.core, few_paths.unwrapped.core.experiment
    path = random_paths(e.sticking, e.start, e.tool, [101])[101]
    assert (info["trajectory"], info["path"]) == ("random", 101)
    assert tuple(info["stiffness"]) == path.stiffness
    assert core.path_points(0)[1:] - core.path_points(0)[0] == pytest.approx(path.path.position)
    _, info = few_paths.reset(seed=1, options={"path": 101, "stiffness": (200, 20, 0)})
    assert info["stiffness"].tolist() == [200, 20, 0]
    _, info = few_paths.reset(seed=1, options=TRIANGLE)
    assert (info["trajectory"], info["path"]) == ("triangle", -1)


def test_an_undithered_episode_sums_to_about_minus_one(few_paths):
    steps = episode(few_paths, quiet(few_paths), seed=1, options={"path": 101})
    final = steps[-1][4]
    assert final["goals_reached"] == few_paths.unwrapped.core.goals[0]
    assert sum(s[1] for s in steps) == pytest.approx(-1.0, abs=0.15)
    assert final["settling_error"] == pytest.approx(1.0, abs=0.15)


def test_options_of_one_reset_come_before_the_fixed_ones():
    env = make_gte(fixed_options={"path": 101})
    assert env.reset(seed=0)[1]["path"] == 101
    assert env.reset(seed=0, options={"trajectory": "triangle"})[1]["trajectory"] == "triangle"
    env = make_gte(fixed_options=TRIANGLE)
    assert env.reset(seed=0, options={"path": 101})[1]["path"] == 101
