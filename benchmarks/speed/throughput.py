"""Steps per second of both experiments and of training, against MuJoCo's own rollout.

    python -m benchmarks.speed.throughput [--rounds 9]

Each pair is measured back to back, round after round, so that a slow moment meets both. What more
cores would give follows from processor seconds: other programs lengthen them little.
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
TARGETS = {"sje": 0.92, "gte": 0.6, "one": 0.62, "two": 1.85, "training": 0.5}
"""Speed over the bare rollout's, or over an environment's alone [-]; assumed."""
STEPS = 100
"""Control steps of an environment step, as by default."""
NSIM_GTE = 64
"""Arms; assumed."""
MANY, CORES, FEW = 1024, 16, 8
"""Environments and cores of the prediction, and arms of a small tile; assumed."""
BATCHES = (1, 64, 1024)
"""Environments whose calls from Python are measured; assumed."""
GTE_START = {"trajectory": "pentagon", "stiffness": (200, 20, 0)}
SJE_START = {"joint": 1, "load": "load", "direction": "+"}


def pairs(
    rounds: int, *parts: Callable[[], object], clock: Callable[[], float] = time.perf_counter
) -> np.ndarray:
    """Return the seconds (rounds, parts) of functions that are called in turn, twice to warm up."""
    found = []
    for _ in range(rounds + 2):
        times = [clock()]
        for part in parts:
            part()
            times.append(clock())
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


def env_and_rollout(
    name: str, count: int, threads: int
) -> tuple[Any, Callable[[], object], Callable[[], object]]:
    """Return environments, and functions: one step of them all, the same of the bare engine."""
    env: Any = gym.make_vec(
        f"stiction_envs:{name}-v0", num_envs=count, threads=threads, autoreset_mode="Disabled"
    )
    start = GTE_START if "GTE" in name else SJE_START
    env.reset(seed=0, options=start)
    plants = [core.rig.plant for core in env.unwrapped.tiles.cores]
    model, space = plants[0].sticking.model, env.single_action_space
    action = np.tile(space.low + 0.1 * (space.high - space.low), (count, 1)).astype(np.float32)
    bare = Batch(model, count, threads)
    bare.state[:] = np.concatenate([p.batch.state for p in plants])
    control = np.zeros((count, STEPS, model.nu))

    def step() -> None:
        over = env.step(action)[2:4]
        assert not np.any(over), "an episode ended: what follows would be less work"

    return env, step, lambda: bare.rollout(STEPS, control=control, record=("qpos",))


def envs(name: str, rounds: int, threads: int) -> list[tuple[float, float, float, float]]:
    """Compare environment steps with rollouts, on one thread and on all.

    Returns:
        For each number of threads `rates` of the two, and the speed over that on one thread.
    """
    counts = sorted({1, threads})
    parts = [env_and_rollout(name, NSIM_GTE, t)[1:] for t in counts]
    # one by one: threads of the engine that wait for their next rollout take time from the others
    found = np.concatenate([pairs(rounds, part) for both in parts for part in both], axis=1)
    return [
        (
            *rates(found[:, [2 * k, 2 * k + 1]], NSIM_GTE * STEPS),
            float(np.median(found[:, 0] / found[:, 2 * k])),
        )
        for k in range(len(counts))
    ]


def serial_part(name: str, rounds: int) -> tuple[float, float, float]:
    """Return what a step of `MANY` environments takes, on one thread, in processor seconds.

    Returns:
        What Python does for all of them between the tiles' steps; what it does within these, with
        its lock held: what a tile takes whatever its size; the rest, which grows with the arms.
    """
    large, step, _ = env_and_rollout(name, MANY, 1)
    small = env_and_rollout(name, FEW, 1)[0]
    cores = large.unwrapped.tiles.cores
    tiles = cores[0], small.unwrapped.tiles.cores[0]
    ids = [np.arange(core.num_envs) for core in tiles]
    actions = [np.tile(np.repeat([0.3, 30.0], 7), (len(i), 1)) for i in ids]
    found = []
    for _ in range(rounds + 1):
        times = [time.thread_time()]
        for core, i, action in zip(tiles, ids, actions, strict=True):
            core.step(i, action)
            times.append(time.thread_time())
        found.append(np.diff(times))
    of_many, of_few = np.median(found[1:], axis=0)
    for core in cores:  # from now on a tile's step is the last one's outcome
        own = np.arange(core.num_envs)
        outcome = core.step(own, np.tile(actions[0][0], (len(own), 1)))
        core.step = lambda *_, outcome=outcome: outcome
    between = np.median(pairs(rounds, step, clock=time.thread_time))
    many, few = (len(i) for i in ids)
    each = (of_many - of_few) / (many - few)
    return float(between), float(len(cores) * (of_few - few * each)), float(MANY * each)


def amdahl(serial: float, parallel: float, cores: int) -> float:
    """Return how many times as fast as one core ``cores`` are, by Amdahl's law."""
    return (serial + parallel) / (serial + parallel / cores)


def prediction(name: str, rounds: int) -> list[str]:
    """Return a row on `CORES` cores: with all of Python serial, and with what is between tiles."""
    between, locked, free = serial_part(name, rounds)
    whole = between + locked + free
    fewest = amdahl(between + locked, free, CORES)
    # threads in engine or controller go on while one is in Python, but only one can be
    most = whole / (between + max((locked + free) / CORES, locked))
    return [
        name,
        f"{100 * between / whole:.1f} %",
        f"{100 * locked / whole:.1f} %",
        f"{amdahl(between + locked, free, 2):.2f}",
        f"{fewest:.1f} to {most:.1f}",
        f"{MANY * STEPS * fewest / whole:,.0f} to {MANY * STEPS * most / whole:,.0f}",
    ]


def calls(rounds: int) -> list[list[str]]:
    """Return rows on what one call of `step` takes beside its physics, on one thread.

    In processor seconds, which other programs lengthen little.
    """
    rows = []
    for name in ("PandaSJE", "PandaGTE", "Ant-v5"):
        for count in BATCHES:
            make = ant if name == "Ant-v5" else env_and_rollout
            env, step, physics = make(name, count, 1)
            found = pairs(rounds, step, physics, clock=time.process_time)
            whole, inside = 1e3 * np.median(found, axis=0)
            env.close()
            each = 1e3 * (whole - inside) / count
            cells = [f"{whole:,.2f}", f"{inside:,.2f}", f"{each:,.0f}", f"{whole / inside:.2f}"]
            rows.append([name, str(count), *cells])
    return rows


def ant(
    name: str, count: int, threads: int
) -> tuple[Any, Callable[[], object], Callable[[], object]]:
    """As `env_and_rollout` for Gymnasium's own environments, which have one thread."""
    assert threads == 1
    env: Any = gym.make_vec(name, num_envs=count, vectorization_mode="sync")
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    ants = [e.unwrapped for e in env.envs]

    def physics() -> None:
        for a in ants:
            mujoco.mj_step(a.model, a.data, nstep=a.frame_skip)

    return env, lambda: env.step(action), physics


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
    load = os.getloadavg()[0]
    ours, bare, share = sje(rounds, threads)
    naive = naive_loop()
    environments, trainings = [], []
    for name in ("PandaGTE", "IiwaGTE", "PandaSJE"):
        for count, found in zip(sorted({1, threads}), envs(name, rounds, threads), strict=True):
            mine, rollout, x, faster = found
            aim = TARGETS["sje" if "SJE" in name else "one" if count == 1 else "gte"]
            cells = [f"{rollout:,.0f}", f"{mine:,.0f}", ratio(x, aim)]
            cells.append("" if count == 1 else ratio(faster, TARGETS["two"]))
            environments.append([name, str(count), *cells])
    predictions = [prediction(name, rounds) for name in ("PandaGTE", "IiwaGTE", "PandaSJE")]
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
        envs=table_text(
            [
                *("environment", "threads", "`Batch.rollout` [steps/s]", "`env.step` [steps/s]"),
                *("ratio", "over one thread"),
            ],
            environments,
        ),
        load=load,
        cores=CORES,
        many=MANY,
        predictions=table_text(
            [
                *("environment", "Python between tiles", "within tiles"),
                *("2 cores", f"{CORES} cores", "steps/s"),
            ],
            predictions,
        ),
        calls=table_text(
            [
                *("environment", "environments", "`env.step` [ms]", "its physics alone [ms]"),
                *("the rest, per environment [µs]", "times the physics"),
            ],
            calls(rounds),
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
