"""Steps per second of both experiments, against MuJoCo's own rollout.

    python -m benchmarks.speed.throughput [--rounds 9]

Each pair is measured back to back, round after round, so that a slow moment meets both.
"""

import os
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from mujoco.batch import Batch

import stiction_envs  # noqa: F401
from benchmarks.harness import Benchmark, machine, met
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job, configurations, load_protocol
from stiction_envs.experiments.sje.rig import BLOCK, RAMP
from stiction_envs.reporting.markdown import table_text

STUDY = Benchmark(__file__, __doc__)
TARGETS = {"sje": 0.92, "gte": 0.75, "one": 0.8, "two": 1.85}
"""Speed over the bare rollout's, or over one thread's [-]; assumed."""
MOST = {"alone": 2.0, "senses": 1.5}
"""Time of one environment over its physics', and under the robot's senses over without; assumed."""
CALLS = 2
"""Steps of a single environment in a measurement: its episode goes on through all of them."""
STEPS = 100
"""Control steps of an environment step, as by default."""
NSIM = 64
"""Arms; assumed."""
GTE_START = {"trajectory": "pentagon", "stiffness": (200, 20, 0)}
SJE_START = {"joint": 1, "load": "load", "direction": "+"}


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


def env_and_rollout(
    name: str, threads: int, *, sensing: str = "ideal"
) -> tuple[Callable[[], object], Callable[[], object]]:
    """Return functions: one step of `NSIM` environments, the same of the bare engine."""
    kwargs: Any = {"threads": threads, "sensing": sensing, "autoreset_mode": "Disabled"}
    env: Any = gym.make_vec(f"stiction_envs:{name}-v0", num_envs=NSIM, **kwargs)
    return _both(env, name, env.unwrapped.batches.cores, env.single_action_space, threads)


def one_and_rollout(name: str) -> tuple[Callable[[], object], Callable[[], object]]:
    """Return functions: `CALLS` steps of a single environment, the same of the bare engine."""
    env: Any = gym.make(f"stiction_envs:{name}-v0", threads=1)
    step, rollout = _both(env, name, [env.unwrapped.core], env.action_space, 1)
    return lambda: [step() for _ in range(CALLS)], lambda: [rollout() for _ in range(CALLS)]


def _both(
    env: Any, name: str, cores: list[Any], space: Any, threads: int
) -> tuple[Callable[[], object], Callable[[], object]]:
    env.reset(seed=0, options=GTE_START if "GTE" in name else SJE_START)
    plants = [core.rig.plant for core in cores]
    model, action = plants[0].sticking.model, space.low + 0.1 * (space.high - space.low)
    actions = np.broadcast_to(action, env.action_space.shape).astype(np.float32)
    bare = Batch(model, sum(p.nsim for p in plants), threads)
    bare.state[:] = np.concatenate([p.batch.state for p in plants])
    control = np.zeros((bare.nsim, STEPS, model.nu))

    def step() -> None:
        over = env.step(actions)[2:4]
        assert not np.any(over), "an episode ended: what follows would be less work"

    return step, lambda: bare.rollout(STEPS, control=control, record=("qpos",))


def envs(name: str, rounds: int, threads: int) -> list[tuple[float, ...]]:
    """Compare environment steps with rollouts, on one thread and on all.

    Returns:
        For each number of threads `rates` of the two, and the speed of each over that on one
        thread.
    """
    counts = sorted({1, threads})
    parts = [env_and_rollout(name, t) for t in counts]
    # one by one: threads of the engine that wait for their next rollout take time from the others
    found = np.concatenate([pairs(rounds, part) for both in parts for part in both], axis=1)
    return [
        (
            *rates(found[:, [2 * k, 2 * k + 1]], NSIM * STEPS),
            *np.median(found[:, :2] / found[:, 2 * k : 2 * k + 2], axis=0).tolist(),
        )
        for k in range(len(counts))
    ]


def alone_and_sensing(name: str, rounds: int) -> list[str]:
    """Return a row: one environment over its physics, many under the robot's senses over ideal."""
    over = []
    ideal, robot = (env_and_rollout(name, 1, sensing=s)[0] for s in ("ideal", "robot"))
    for target, parts in ("alone", one_and_rollout(name)), ("senses", (robot, ideal)):
        found = pairs(rounds, *parts)
        over.append(ratio(float(np.median(found[:, 0] / found[:, 1])), MOST[target], most=True))
    return [name, *over]


def ratio(value: float, target: float, *, most: bool = False) -> str:
    sign = "≤" if most else "≥"
    return f"{value:.2f} ({met(value, target, most=most)}: {sign} {target:g})"


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    options = parser.parse_args()
    rounds, threads = options.rounds, options.threads
    load = os.getloadavg()[0]
    ours, bare, share = sje(rounds, threads)
    environments = []
    for name in ("PandaGTE", "IiwaGTE", "PandaSJE"):
        for count, found in zip(sorted({1, threads}), envs(name, rounds, threads), strict=True):
            mine, rollout, x, faster, bare_faster = found
            aim = TARGETS["sje" if "SJE" in name else "one" if count == 1 else "gte"]
            cells = [f"{rollout:,.0f}", f"{mine:,.0f}", ratio(x, aim)]
            cells += (
                ["", ""] if count == 1 else [ratio(faster, TARGETS["two"]), f"{bare_faster:.2f}"]
            )
            environments.append([name, str(count), *cells])
    STUDY.write_page(
        options,
        machine=machine(),
        threads=threads,
        share=share,
        sje=table_text(
            ["", "steps/s", "over the rollout"],
            [
                ["`Batch.rollout`", f"{bare:,.0f}", "1"],
                ["SJE, all included", f"{ours:,.0f}", ratio(share, TARGETS["sje"])],
            ],
        ),
        envs=table_text(
            [
                *("environment", "threads", "`Batch.rollout` [steps/s]", "`env.step` [steps/s]"),
                *("ratio", "over one thread", "the rollout's own"),
            ],
            environments,
        ),
        small=table_text(
            ["environment", "one: its step over its physics", f"{NSIM}: robot's senses over ideal"],
            [
                alone_and_sensing(f"{arm}{kind}", rounds)
                for arm in ("Panda", "Iiwa")
                for kind in ("SJE", "GTE")
            ],
        ),
        load=load,
    )


if __name__ == "__main__":
    main()
