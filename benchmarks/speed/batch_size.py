"""How the cost of an environment grows with its batch, and how many arms a tile should hold.

    python -m benchmarks.speed.batch_size [--rounds 15] [--sizes 1 8 64 256 1024 4096]

Batches are timed in turn, round after round, so that a slow moment of the machine meets all of
them. What a tile should be (`arms_per_thread`, see `stiction_envs.envs.tiles`) is read from the
second table: 1024 environments in other tiles.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import stiction_envs  # noqa: F401
from benchmarks.harness import ROOT, Benchmark, machine, met
from benchmarks.reference_loop import seconds
from stiction_envs.experiments.episodes import Episodes
from stiction_envs.experiments.gte.episodes import GTEEpisodes
from stiction_envs.experiments.sje.episodes import SJEEpisodes
from stiction_envs.reporting.markdown import table_text

STUDY = Benchmark(__file__, __doc__)
SIZES, MANY = (1, 8, 64, 256, 1024, 4096), 1024
"""Environments of a batch, and of that whose tiles are compared; assumed."""
NAMES: dict[str, type[Episodes]] = {"PandaGTE-v0": GTEEpisodes, "PandaSJE-v0": SJEEpisodes}
OPTIONS: dict[str, dict[str, Any]] = {
    "PandaSJE-v0": {"joint": 1, "load": "load", "direction": "+"},
    "PandaGTE-v0": {"trajectory": "pentagon", "stiffness": (200, 20, 0)},
}
STEPS, EPISODE = 100, 40
"""Control steps of an environment step, as by default; steps before an episode can be over."""
FLAT, EACH_MB = 0.95, 0.3
"""Targets: speed at 1024 over that of the best batch, memory of an environment [MB]; assumed."""
MEMORY = """
from benchmarks.speed.batch_size import make, resident_mb
make({name!r}, 1)()
before = resident_mb()
step = make({name!r}, {count})
for _ in range(3):
    step()
print((resident_mb() - before) / {count})
"""


def make(name: str, count: int, per_tile: int | None = None) -> Callable[[], float]:
    """Return a function that makes one step of a batch and returns physics steps/s."""
    core = NAMES[name]
    usual = core.arms_per_thread
    core.arms_per_thread = per_tile or usual
    env: Any = gym.make_vec(name, num_envs=count, autoreset_mode="Disabled")
    core.arms_per_thread = usual
    space = env.single_action_space
    action = np.tile(space.low + 0.1 * (space.high - space.low), (count, 1))
    left = 0

    def step() -> float:
        nonlocal left
        if left == 0:
            env.reset(seed=0, options=OPTIONS[name])
            left = EPISODE
        left -= 1
        start = time.perf_counter()
        over = env.step(action)[2:4]
        assert not np.any(over), "an episode ended: what follows would be less work"
        return count * STEPS / (time.perf_counter() - start)

    return step


def speeds(
    makers: Sequence[Callable[[], Callable[[], float]]], rounds: int, against: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return median physics steps/s of batches, and over one of them; the first round warms."""
    steps = [make_one() for make_one in makers]
    rates = np.array([[step() for step in steps] for _ in range(rounds + 1)])[1:]
    del steps
    gc.collect()
    return np.median(rates, axis=0), np.median(rates / rates[:, [against]], axis=0)


def memory(name: str, count: int) -> float:
    """Return what a batch adds to a process, in MB per environment."""
    code = [sys.executable, "-c", MEMORY.format(name=name, count=count)]
    ran = subprocess.run(code, cwd=ROOT, check=True, capture_output=True, text=True)
    return float(ran.stdout.splitlines()[-1])


def resident_mb() -> float:
    """Return the resident memory of this process (Linux)."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def measure(name: str, sizes: list[int], rounds: int) -> dict[str, object]:
    """Return what the page says of one environment."""
    usual, threads = NAMES[name].arms_per_thread, os.cpu_count() or 1
    batches = [partial(make, name, n) for n in sizes]
    rates, ratio = speeds(batches, rounds, sizes.index(MANY))
    ratio /= ratio[np.argmax(rates)]
    each = {n: memory(name, n) for n in sizes if n >= 64}
    by_size = [
        [str(n), f"{rates[k]:,.0f}", f"{ratio[k]:.2f}", f"{each[n]:.2f}" if n in each else ""]
        for k, n in enumerate(sizes)
    ]
    flat = float(ratio[sizes.index(MANY)])
    tiles = sorted({8, 16, 32, 64, 128, 256, usual} & set(range(MANY // threads)))
    batches = [partial(make, name, MANY, t) for t in [*tiles, MANY]]
    rates, ratio = speeds(batches, rounds, tiles.index(usual))
    by_tile = [
        [text, f"{rate:,.0f}", f"{x:.2f}"]
        for text, rate, x in zip([*map(str, tiles), "one per thread"], rates, ratio, strict=True)
    ]
    return {
        "tile": usual,
        "flat": f"{flat:.2f} of the best batch's speed (target {FLAT}: {met(flat, FLAT)})",
        "memory": f"{each[MANY]:.2f} MB each "
        f"(target {EACH_MB}: {met(each[MANY], EACH_MB, most=True)})",
        "by_size": table_text(
            ["environments", "physics steps/s", "over the best batch", "MB each"], by_size
        ),
        "by_tile": table_text(
            [f"{MANY} environments in tiles of", "physics steps/s", "over the usual tile"], by_tile
        ),
    }


def main() -> None:
    parser = STUDY.parser()
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SIZES), metavar="N")
    parser.add_argument("--only", nargs="+", choices=list(NAMES), default=list(NAMES))
    options = parser.parse_args()
    sizes, loop = sorted({*options.sizes, MANY}), seconds()
    found = {name: measure(name, sizes, options.rounds) for name in options.only}
    STUDY.write_page(options, machine=machine(loop), rounds=options.rounds, found=found, many=MANY)


if __name__ == "__main__":
    main()
