from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RescaleAction

from stiction_envs.control.settings import ImpedanceSettings
from stiction_envs.control.trajectory import MotionLimits
from stiction_envs.envs.gte import GTEEnv, GTEVectorEnv
from stiction_envs.errors import StictionError
from stiction_envs.experiments.gte.experiment import GeneratedTrajectoryExperiment
from stiction_envs.experiments.gte.measures import measure
from stiction_envs.experiments.gte.protocol import Case
from stiction_envs.experiments.gte.undithered import fingerprint
from stiction_envs.friction.parameters import load_friction
from stiction_envs.measured import AmplitudeRow
from stiction_envs.robots import load_arm
from tests.envs.helpers import (
    IIWA_GTE,
    PANDA,
    PANDA_GTE,
    TRIANGLE,
    episode,
    make,
    make_gte,
    mild,
    quiet,
    same,
    sprint,
)
from tests.envs.test_sje import TWO_JOINTS

QUIET = {"power_weight": 0.0, "torque_rate_weight": 0.0, "shaking_weight": 0.0}


@pytest.fixture(scope="module")
def panda():
    env = make_gte()
    yield env
    env.close()


def rows_of(action: np.ndarray) -> tuple[AmplitudeRow, ...]:
    """Return the table of dither that says what a constant action says."""
    a, f = np.split(np.asarray(action, dtype=float), 2)
    return tuple(AmplitudeRow(j + 1, f[j], a[j]) for j in range(len(a)) if a[j] > 0)


def shaken(env: gym.Env, share: float = 0.3) -> np.ndarray:
    """Return an action that dithers all joints but the third, as float64: no table is float32."""
    action = quiet(env).astype(float)
    action[:7] = share * env.action_space.high[:7]
    action[7:] = [50, 30, 30, 50, 15, 15, 15]
    action[2] = 0.0
    return action


@pytest.mark.parametrize("name", [PANDA_GTE, IIWA_GTE])
def test_gymnasium_check(name):
    env = make_gte(name, fixed_options=TRIANGLE)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env.unwrapped, skip_render_check=True)
    # amplitudes in N·m and frequencies in Hz cannot be in [-1, 1]: RescaleAction is for that
    assert all("symmetric and normalized" in str(w.message) for w in caught)


def test_stable_baselines_check():
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(RescaleAction(make_gte(fixed_options=TRIANGLE), -1, 1))


def check_reproduction(env: gym.Env, robot: str, case: Case, **experiment) -> None:
    """Compare the env's iterations 0 and 2 of a case with the experiment's, bit for bit."""
    bench = GeneratedTrajectoryExperiment(robot, **experiment)
    run = bench.run([case], iterations=3)[0]
    measures = measure(run)
    action = quiet(env).astype(float)
    for row in case.dither:
        action[row.joint - 1], action[6 + row.joint] = row.amplitude_nm, row.frequency_hz
    for k in (0, 2):
        options = {"trajectory": case.trajectory, "stiffness": case.stiffness, "iteration": k}
        final = episode(env, action, seed=11, options=options)[-1][4]
        trace = env.unwrapped.core.recorder.trace[0]
        position, error = np.concatenate(trace.position), np.concatenate(trace.error)
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
    """What `stiction gte` runs, by key of the scatter: the same path, the same numbers."""
    env = gym.make(PANDA_GTE, render_mode="rgb_array")
    case = Case(trajectory="triangle", stiffness=(200, 20, 0), dither=rows_of(shaken(env)))
    check_reproduction(env, "panda", case)


def test_so_it_is_on_the_held_controller_and_with_another_seed():
    env = make_gte(IIWA_GTE, scatter_seed=3, render_mode="rgb_array", control_interval_s=0.04)
    case = Case(trajectory="pentagon", stiffness=(400, 40, 5), dither=rows_of(shaken(env)))
    check_reproduction(env, "iiwa7", case, seed=3, motion=sprint())


@pytest.mark.parametrize("kind", ["feedforward", "push"])
def test_so_it_is_with_compensation(kind):
    """Undithered runs are compensated as well, so that a reward of −1 still is no dither."""
    env = make_gte(compensation=kind, tool=(0.0, 0.0, 0.1), render_mode="rgb_array")
    compensation = env.unwrapped.core.compensation
    case = Case(
        trajectory="triangle",
        stiffness=(200, 20, 0),
        dither=rows_of(shaken(env)),
        compensation=compensation,
    )
    check_reproduction(env, "panda", case, motion=sprint(), tool=(0.0, 0.0, 0.1))
    options = {"trajectory": "triangle", "stiffness": (200, 20, 0)}
    bases = [
        episode(e, quiet(e), seed=1, options=options)[-1][4]["undithered_error"]
        for e in (env, make_gte(tool=(0.0, 0.0, 0.1)))
    ]
    assert not np.array_equal(*bases)


def test_the_control_interval_does_not_matter_to_a_constant_action():
    """Physics, sampling and the end of the episode's error do not know of the interval."""
    finals = []
    for interval in (0.1, 0.24):
        env = make_gte(control_interval_s=interval, **QUIET)
        steps = episode(env, shaken(env), seed=5, options=TRIANGLE)
        finals.append(steps[-1][4])
    assert np.array_equal(finals[0]["error"], finals[1]["error"])
    assert finals[0]["duration"] == finals[1]["duration"]
    for name in ("tracking_error", "shaking"):
        assert finals[0][name] == finals[1][name]
    assert np.array_equal(finals[0]["error_left"], finals[1]["error_left"])
    assert finals[0]["settling_error"] == pytest.approx(finals[1]["settling_error"], rel=1e-12)


def test_same_seed_same_episode_on_any_number_of_threads(panda):
    action = shaken(panda)
    first, again = (episode(panda, action, seed=5, options=TRIANGLE) for _ in range(2))
    assert same(first, again)
    one = make_gte(threads=1)
    assert same(episode(one, action, seed=5, options=TRIANGLE), first)
    other = episode(panda, action, seed=6, options=TRIANGLE)
    assert not np.array_equal(other[-1][4]["error"], first[-1][4]["error"])


def test_seeds_draw_every_option():
    env = GTEVectorEnv(16, motion=sprint())
    _, infos = env.reset(seed=0)
    cases = {(t, *k) for t, k in zip(infos["trajectory"], infos["stiffness"], strict=True)}
    k = ((200.0, 20.0, 0.0), (400.0, 40.0, 0.0))
    assert cases == {(t, *x) for t in ("triangle", "pentagon") for x in k}


def test_options_do_not_shift_the_random_stream(panda):
    panda.reset(seed=3)
    free = panda.reset()
    panda.reset(seed=3, options={**TRIANGLE, "iteration": 4})
    assert same(panda.reset(), free)
    _, info = panda.reset(options={"stiffness": [400, 40, 0]})
    assert info["stiffness"].tolist() == [400.0, 40.0, 0.0]


def test_amplitude_zero_is_no_dither_at_any_frequency(panda):
    def wobble(k: int) -> np.ndarray:
        action = quiet(panda)
        action[7:] = 5 + 7 * (k % 13)
        return action

    still = episode(panda, quiet(panda), seed=4, options=TRIANGLE)
    wobbling = episode(panda, wobble, seed=4, options=TRIANGLE)
    names = panda.unwrapped.observation_names
    physical = [k for k, n in enumerate(names) if not n.startswith("frequency")]
    for a, b in zip(still, wobbling, strict=True):
        assert np.array_equal(a[0][physical], b[0][physical])
        assert a[1:4] == b[1:4]


def test_dither_can_come_and_go_without_losing_its_phase(panda):
    action = shaken(panda)
    rig = panda.unwrapped.core.rig
    panda.reset(seed=8, options=TRIANGLE)
    panda.step(action)
    phase, t = rig.dither.phase.copy(), rig.step * 1e-3
    off = action.copy()
    off[:7] = 0.0
    before, _, _, _, info = panda.step(off)
    assert not rig.dither_torque.any()
    assert info["reward_terms"]["power"] == 0
    panda.step(action)
    assert rig.dither_torque.any()
    assert np.array_equal(rig.dither.phase, phase)
    faster = action.copy()
    faster[7:] += 1.7
    t = rig.step * 1e-3
    angle = 2 * np.pi * rig.dither.frequency * t[:, None] + rig.dither.phase
    panda.step(faster)
    assert 2 * np.pi * rig.dither.frequency * t[:, None] + rig.dither.phase == pytest.approx(angle)
    assert before in panda.observation_space


def test_dither_changes_the_path_and_shakes(panda):
    finals = [
        episode(panda, action, seed=4, options=TRIANGLE)[-1][4]
        for action in (quiet(panda), shaken(panda, share=1.0))
    ]
    assert not np.array_equal(finals[0]["error"], finals[1]["error"])
    assert finals[1]["shaking"] > finals[0]["shaking"]
    for name in ("undithered_error", "undithered_shaking"):
        assert np.array_equal(finals[0][name], finals[1][name])


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
    assert see["remaining"] == pytest.approx(float(core.rig.sequencer.segment.duration[0]))
    observation, _, _, _, info = panda.step(mild(panda, 6, share=0.25))
    see = dict(zip(names, observation, strict=True))
    assert see["amplitude_6"] == pytest.approx(-0.5)
    assert see["remaining"] == pytest.approx(float(core.rig.sequencer.segment.duration[0]) - 0.2)
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
    expected = jacobian.T @ (controller._gain[0] @ controller._state[0])
    assert np.abs(core.rig.dither_torque[0]).max() > 0.1
    assert observation[mine] * core.stiction == pytest.approx(expected, abs=0.02)
    assert np.abs(expected).max() > 0.5
    observation, _ = panda.reset(seed=2, options=TRIANGLE)
    assert not observation[mine].any(), "nothing is left of the episode before"


def test_actions_have_the_bounds_of_the_sje():
    assert make_gte().action_space == make(PANDA).action_space


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"joint": 1}, ("joint", "trajectory, path, stiffness, iteration")),
        ({"path": -1}, ("path -1", "whole number")),
        ({"path": "1"}, ("path '1'", "whole number")),
        ({"trajectory": "pentagon", "path": 1}, ("path 1", "pentagon", "expected 'random'")),
        ({"trajectory": "square"}, ("square", "triangle, pentagon, random")),
        ({"trajectory": 3}, ("3", "triangle, pentagon")),
        ({"stiffness": (200, 20)}, ("stiffness", "three")),
        ({"stiffness": (200, -20, 0)}, ("stiffness", "-20")),
        ({"stiffness": (200, np.nan, 0)}, ("stiffness", "nan")),
        ({"stiffness": 200}, ("stiffness", "three")),
        ({"stiffness": ("a", 1, 2)}, ("stiffness", "three")),
        ({"iteration": -1}, ("iteration", "-1")),
        ({"iteration": 1.0}, ("iteration", "1.0")),
        ({"iteration": True}, ("iteration", "True")),
        (["trajectory"], ("list", "dict")),
    ],
)
def test_wrong_options(panda, options, words):
    with pytest.raises(StictionError) as error:
        panda.unwrapped.reset(seed=0, options=options)
    message = str(error.value)
    assert "\n" not in message
    assert all(w in message for w in words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((2, np.nan), ("amplitude of joint 3", "nan")),
        ((0, 1e6), ("amplitude of joint 1", "expected 0 to")),
        ((7, 4.0), ("frequency of joint 1", "expected 5 to 100 Hz")),
    ],
)
def test_wrong_actions(panda, change, words):
    panda.reset(seed=0, options=TRIANGLE)
    action = quiet(panda)
    action[change[0]] = change[1]
    with pytest.raises(StictionError) as error:
        panda.unwrapped.step(action)
    assert all(w in str(error.value) for w in words)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"control_interval_s": 0.05}, "multiples of 0.02 s"),
        ({"shaking_weight": -1}, "shaking_weight"),
        ({"settling_weight": 1.5}, "settling_weight 1.5: expected 0 to 1"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"random_paths": 0}, "random_paths 0: expected a whole number from 1"),
        ({"fixed_options": {"trajectory": "line"}}, "line"),
        ({"robot": "fanuc"}, "fanuc"),
        ({"friction": "nowhere.toml"}, "nowhere.toml"),
        ({"start": [0.0] * 6}, "6 angles: expected 7"),
        ({"start": "rest"}, "expected 7 angles"),
        ({"tool": (0.0, 0.1)}, "three finite numbers"),
        ({"compensation": "pull"}, "feedforward, push"),
        ({"render_mode": "ascii"}, "rgb_array"),
    ],
)
def test_wrong_arguments(arguments, word):
    with pytest.raises(StictionError, match=word):
        GTEEnv(**arguments)


def test_step_needs_a_running_episode():
    env = make_gte().unwrapped
    with pytest.raises(StictionError, match="reset"):
        env.step(quiet(env))


def test_truncation_has_no_error_sums():
    env = GTEEnv(control_interval_s=0.2, motion=sprint(), max_episode_steps=4)
    steps = episode(env, quiet(env), seed=0, options=TRIANGLE)
    assert len(steps) == 5
    assert steps[-1][3]
    assert not steps[-1][2]
    final = steps[-1][4]
    assert np.isnan(final["error"]).all()
    assert np.isnan(final["duration"])
    assert np.isnan(final["error_left"]).all()
    assert 0 < final["tracking_error"] < 1
    limited = gym.make(PANDA_GTE, motion=sprint(), max_episode_steps=2)
    assert episode(limited, quiet(env), seed=0, options=TRIANGLE)[-1][3]


def test_what_an_undithered_run_depends_on():
    p = load_friction("panda")
    of = GeneratedTrajectoryExperiment
    usual = of("panda")
    others = [
        of("iiwa7"),
        of("panda", scatter=False),
        of("panda", seed=1),
        of("panda", friction=p.replace(stiction=1.2 * p.stiction)),
        of("panda", settings=ImpedanceSettings(damping_design="mass")),
        of("panda", start=[0.1, *usual.start[1:]]),
        of("panda", tool=(0.0, 0.0, 0.1034)),
        of("panda", settings=ImpedanceSettings(damping_ratio=[1, 1, 1, 1, 1, 0.9])),
        of("panda", motion=MotionLimits(patience=2.0)),
        of(load_arm("panda", payload=(1.0, 0.0, 0.0, 0.05))),
        of("panda", controller_model=load_arm("panda", payload=(1.0, 0.0, 0.0, 0.05))),
    ]
    assert len({fingerprint(e) for e in [usual, *others]}) == 1 + len(others)
    assert fingerprint(of("panda")) == fingerprint(usual)


def test_a_wrong_controller_model_shows_in_the_error():
    heavy = (1.0, 0.0, 0.0, 0.05)
    finals = []
    for controller_model in (None, load_arm("panda")):
        env = make_gte(payload=heavy, controller_model=controller_model, **QUIET)
        finals.append(episode(env, quiet(env), seed=0, options=TRIANGLE)[-1][4])
    right, wrong = (f["undithered_error"] for f in finals)
    assert wrong[2] > 1.5 * right[2], "an unknown payload pulls the flange down"


def test_own_arm_with_two_joints(tmp_path):
    path = tmp_path / "two.xml"
    path.write_text(TWO_JOINTS)
    env = make_gte(robot=str(path))
    assert env.action_space.shape == (4,)
    assert env.observation_space.shape == (30,)
    final = episode(env, mild(env, 2), seed=0, options=TRIANGLE)[-1][4]
    assert np.isfinite(final["error"]).all()
    assert final["goals_reached"] == 3
