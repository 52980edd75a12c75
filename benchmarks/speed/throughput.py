"""Steps per second of both experiments and of training, against MuJoCo's own rollout.

    python -m benchmarks.speed.throughput [--rounds 9]

Each pair is measured back to back, round after round, so that a slow moment meets both.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

import stiction_envs  # noqa: F401
from benchmarks.harness import Benchmark, machine, met
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job, configurations, load_protocol
from stiction_envs.experiments.sje.rig import BLOCK, RAMP
from stiction_envs.reporting.markdown import table_text
from tuning.policies.algorithms import make_env, make_model
from tuning.policies.settings import policy_settings
from tuning.policies.task import Task

STUDY = Benchmark(__file__, __doc__)
TARGETS = {"sje": 0.9, "gte": 0.5, "training": 0.5}
"""Speed over the bare rollout's, or over an environment's alone [-]; assumed."""
STEPS = 100
"""Control steps of an environment step, as by default."""
NSIM_GTE = 64
"""Arms; assumed."""


def pairs(rounds: int, *parts: Callable[[], object]) -> np.ndarray:
    """Return the seconds (rounds, parts) of functions that are called in turn, twice to warm up."""
    found = []
    for _ in range(rounds + 2):
        times = [time.perf_counter()]
        for part in parts:
            part()
            times.append(time.perf_counter())
        found.append(np.diff(times))
    return np.array(found[2:])


def rates(seconds: np.ndarray, steps: int) -> tuple[float, float, float]:
    """Return steps/s of two parts, medians, and the second's time over the first's."""
    ours, bare = seconds.T
    return steps / np.median(ours), steps / np.median(bare), float(np.median(bare / ours))


def sje(rounds: int, threads: int) -> tuple[float, float, float]:
    """Compare ramps of 28 configurations x 13 settings with a rollout of the same model."""
    slow = load_protocol("panda").replace(ramp_rate=1e-3)  # ramps outlast the measurement
    experiment = SingleJointExperiment("panda", protocol=slow, threads=threads)
    settings = [(0.0, 0.0)] + [(f, a) for f in (80.0, 50.0, 30.0, 15.0) for a in (0.1, 0.2, 0.3)]
    jobs = [Job(c, f, a) for c in configurations(7) for f, a in settings]
    rig, ids = experiment.rig(len(jobs)), np.arange(len(jobs))
    rig.place(ids, [j.configuration for j in jobs])
    rig.approach(ids, [(k,) for k in range(len(jobs))])
    rig.set_dither(
        ids,
        amplitude=np.array([[j.amplitude_nm] for j in jobs]),
        frequency=np.array([[j.frequency_hz] for j in jobs]),
    )
    while not (rig.stage == RAMP).all():
        rig.advance(ids[rig.stage != RAMP])
    model, blocks = rig.plant.sticking.model, 6
    bare = Batch(model, len(ids), threads)
    bare.state[:] = rig.plant.batch.state
    control = np.zeros((len(ids), BLOCK, model.nu))

    def ramps() -> None:
        for _ in range(blocks):
            assert len(rig.advance(ids)) == 0, "a ramp ended: the measurement would shrink"

    def rollout() -> None:
        for _ in range(blocks):
            bare.rollout(BLOCK, control=control, record=("qpos",))

    return rates(pairs(rounds, ramps, rollout), len(ids) * BLOCK * blocks)


def naive_loop(seconds: float = 3.0) -> float:
    """Return steps/s of one `MjData` with ramp, dither and low-pass computed in Python."""
    experiment = SingleJointExperiment("panda")
    model = experiment.sticking.model
    data = mujoco.MjData(model)
    data.qpos[experiment.sticking.motor] = experiment.poses.q[6, 0]
    y, steps, gain = np.zeros(7), 0, experiment.interface.lowpass_gain
    amplitude, frequency = np.zeros(7), np.full(7, 15.0)
    amplitude[6] = 0.8
    start = time.perf_counter()
    while time.perf_counter() - start < seconds:
        command = amplitude * np.sin(2 * np.pi * frequency * 1e-3 * steps)
        command[6] += 1e-6 * steps
        y += gain * (np.clip(command, y - 1.0, y + 1.0) - y)
        data.ctrl[:7] = y
        mujoco.mj_step(model, data)
        steps += 1
    return steps / (time.perf_counter() - start)


def gte(robot: str, rounds: int, threads: int) -> tuple[float, float, float]:
    """Compare environment steps, controller and measures included, with a rollout."""
    env: Any = gym.make_vec(f"stiction_envs:{robot}GTE-v0", num_envs=NSIM_GTE, threads=threads)
    env.reset(seed=0, options={"trajectory": "pentagon", "stiffness": (200, 20, 0)})
    plants = [core.rig.plant for core in env.unwrapped.tiles.cores]
    model = plants[0].sticking.model
    action = np.tile(np.repeat([0.3, 30.0], 7), (NSIM_GTE, 1)).astype(np.float32)
    bare = Batch(model, NSIM_GTE, threads)
    bare.state[:] = np.concatenate([p.batch.state for p in plants])
    control = np.zeros((NSIM_GTE, STEPS, model.nu))
    found = pairs(
        rounds,
        lambda: env.step(action),
        lambda: bare.rollout(STEPS, control=control, record=("qpos",)),
    )
    return rates(found, NSIM_GTE * STEPS)


def training(experiment: str, rounds: int, threads: int) -> tuple[float, float, float, float]:
    """Return steps/s of PPO's rollouts, of an environment alone, their ratio, and with updates."""
    torch.set_num_threads(1)
    settings, rng = policy_settings(), np.random.default_rng(0)
    ppo, task = settings.ppo, Task(robot="panda", experiment=experiment, threads=threads)
    alone: Any = task.make(ppo.envs)
    alone.reset(seed=0)
    low, high = alone.single_action_space.low, alone.single_action_space.high
    model: Any = make_model(ppo, make_env(task, ppo.envs, settings.run, ppo.gamma), 0)
    _, callback = model._setup_learn(10**9, None)
    actions: list[np.ndarray] = []

    def draw() -> None:
        x = rng.normal(size=(ppo.rollout, *alone.action_space.shape))
        actions[:] = low + 0.5 * (np.clip(np.exp(ppo.log_std) * x, -1, 1) + 1) * (high - low)

    def steps() -> None:
        for action in actions:
            alone.step(action)

    def rollout() -> None:
        model.collect_rollouts(
            model.env, callback, model.rollout_buffer, n_rollout_steps=model.n_steps
        )

    found = pairs(rounds, draw, steps, rollout, model.train)[:, 1:]
    count = ppo.rollout * ppo.envs
    return (
        *rates(found[:, [1, 0]], count),
        count / float(np.median(found[:, 1] + found[:, 2])),
    )


def ratio(value: float, target: float) -> str:
    return f"{value:.2f} ({met(value, target)}: ≥ {target:g})"


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    options = parser.parse_args()
    rounds, threads = options.rounds, options.threads
    ours, bare, share = sje(rounds, threads)
    naive = naive_loop()
    environments, trainings = [], []
    for robot in ("Panda", "Iiwa"):
        for count in sorted({1, threads}):
            mine, rollout, x = gte(robot, rounds, count)
            cells = [f"{rollout:,.0f}", f"{mine:,.0f}", ratio(x, TARGETS["gte"])]
            environments.append([robot, str(count), *cells])
    for experiment in ("sje", "gte"):
        rollout, alone, x, updated = training(experiment, rounds, threads)
        cells = [f"{alone:,.0f}", f"{rollout:,.0f}", ratio(x, TARGETS["training"])]
        trainings.append([f"Panda{experiment.upper()}", *cells, f"{updated:,.0f}"])
    STUDY.write_page(
        options,
        machine=machine(),
        threads=threads,
        share=share,
        naive=ours / naive,
        sje=table_text(
            ["", "steps/s", "over the rollout"],
            [
                ["`Batch.rollout`", f"{bare:,.0f}", "1"],
                ["SJE, all included", f"{ours:,.0f}", ratio(share, TARGETS["sje"])],
                ["one `MjData`, control in Python", f"{naive:,.0f}", f"{naive / bare:.3f}"],
            ],
        ),
        gte=table_text(
            ["robot", "threads", "`Batch.rollout` [steps/s]", "`env.step` [steps/s]", "ratio"],
            environments,
        ),
        training=table_text(
            [
                *("environment", "alone [steps/s]", "PPO's rollouts [steps/s]", "ratio"),
                "rollouts and updates [steps/s]",
            ],
            trainings,
        ),
    )


if __name__ == "__main__":
    main()
