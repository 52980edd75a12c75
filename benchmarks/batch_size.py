"""How the cost of an environment grows with the batch: one command, written beside this file.

    python benchmarks/batch_size.py [--rounds 15] [--sizes 1 8 64 256 1024 4096]

Batches are timed in turn, round after round, so that a slow moment of the machine meets all of
them; compare the ratios. What a tile should be (`arms_per_thread` of the cores, see
`stiction_envs/envs/tiles.py`) is read from the second table: 1024 environments in other tiles.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
from reference_loop import USUAL_S, seconds

import stiction_envs  # noqa: F401
from stiction_envs.envs.gte_core import GTECore
from stiction_envs.envs.sje_core import SJECore

HERE = Path(__file__).parent
SIZES = (1, 8, 64, 256, 1024, 4096)
MANY = 1024
NAMES = {"PandaSJE-v0": SJECore, "PandaGTE-v0": GTECore}
OPTIONS = {
    "PandaSJE-v0": {"joint": 1, "load": "load", "direction": "+"},
    "PandaGTE-v0": {"trajectory": "pentagon", "stiffness": (200, 20, 0)},
}
STEPS = 100
"""Control steps of an environment step, as by default."""
FLAT, EACH_MB = 0.95, 0.3
"""Targets: speed at 1024 over that of the best batch, memory of an environment."""


def make(name, count, per_tile=None):
    """Return a function that makes one step of a batch whose episodes last."""
    core = NAMES[name]
    usual = core.arms_per_thread
    core.arms_per_thread = per_tile or usual
    env = gym.make_vec(name, num_envs=count, autoreset_mode="Disabled")
    core.arms_per_thread = usual
    env.reset(seed=0, options=OPTIONS[name])
    low = env.single_action_space.low
    action = np.tile(low + 0.1 * (env.single_action_space.high - low), (count, 1))
    left = [0]

    def step():
        if left[0] == 0:  # before the first episode can be over
            env.reset(seed=0, options=OPTIONS[name])
            left[0] = 40
        left[0] -= 1
        start = time.perf_counter()
        over = env.step(action)[2:4]
        assert not np.any(over), "an episode ended: what follows would be less work"
        return count * STEPS / (time.perf_counter() - start)

    return step


def speeds(makers, rounds):
    """Return (rounds, batches) physics steps per second, batches in turn; the first round warms."""
    steps = [make_one() for make_one in makers]
    out = np.array([[step() for step in steps] for _ in range(rounds + 1)])[1:]
    del steps
    gc.collect()
    return out


def ratios(rates, against):
    """Return medians of the rates, and of their ratios to one batch, round by round."""
    return np.median(rates, axis=0), np.median(rates / rates[:, [against]], axis=0)


def memory(name, count):
    """Return what a batch adds to the process, in MB per environment; in a process of its own."""
    code = f"""
import json, sys
sys.path.insert(0, {str(HERE)!r})
from batch_size import make, resident_mb
make({name!r}, 1)()
before = resident_mb()
step = make({name!r}, {count})
for _ in range(3):
    step()
print(json.dumps((resident_mb() - before) / {count}))
"""
    ran = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return float(json.loads(ran.stdout.splitlines()[-1]))


def resident_mb():
    """Return the resident memory of this process (Linux)."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def mark(met):
    return "met" if met else "missed"


def page(name, sizes, rounds):
    """Return the lines of one environment."""
    core, threads = NAMES[name], os.cpu_count()
    rates, ratio = ratios(
        speeds([lambda n=n: make(name, n) for n in sizes], rounds),
        sizes.index(MANY),
    )
    best = int(np.argmax(rates))
    each = {n: memory(name, n) for n in sizes if n >= 64}
    lines = [f"## {name}", ""]
    lines += [f"Tiles of {core.arms_per_thread} environments per thread, {threads} threads.", ""]
    lines += [
        "| environments | physics steps/s | over the best batch | MB each |",
        "|---|---|---|---|",
    ]
    for k, n in enumerate(sizes):
        mb = f"{each[n]:.2f}" if n in each else ""
        lines.append(f"| {n} | {rates[k]:,.0f} | {ratio[k] / ratio[best]:.2f} | {mb} |")
    flat, mb = 1.0 / ratio[best], each[MANY]
    lines += [
        "",
        f"{MANY} environments run at {flat:.2f} of the best batch (target {FLAT}): "
        f"{mark(flat >= FLAT)}. They take {mb:.2f} MB each (target {EACH_MB}): "
        f"{mark(mb <= EACH_MB)}.",
        "",
    ]
    tiles = sorted({16, 32, 64, 128, 256, 512, core.arms_per_thread} & set(range(MANY // threads)))
    rates, ratio = ratios(
        speeds([lambda t=t: make(name, MANY, t) for t in [*tiles, MANY]], rounds),
        tiles.index(core.arms_per_thread),
    )
    lines += [f"| {MANY} environments in tiles of | physics steps/s | over the usual tile |"]
    lines += ["|---|---|---|"]
    lines += [f"| {t} per thread | {rates[k]:,.0f} | {ratio[k]:.2f} |" for k, t in enumerate(tiles)]
    return [*lines, f"| all at once | {rates[-1]:,.0f} | {ratio[-1]:.2f} |", ""]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SIZES), metavar="N")
    parser.add_argument("--only", nargs="+", choices=list(NAMES), default=list(NAMES))
    args = parser.parse_args()
    sizes = sorted({*args.sizes, MANY})
    loop = seconds()
    lines = [
        "# Cost of an environment by the size of its batch",
        "",
        f"Written by `python benchmarks/batch_size.py`. Python {platform.python_version()}, MuJoCo "
        f"{mujoco.__version__}, numpy {np.__version__}; environment steps of 0.1 s with dither, "
        f"batches timed in turn, medians of {args.rounds} rounds. The reference loop "
        f"(`benchmarks/reference_loop.py`) took {loop:.1f} s, {USUAL_S} s on the quiet machine. "
        "Speeds are of this machine at that moment; compare the ratios.",
        "",
    ]
    for name in args.only:
        lines += page(name, sizes, args.rounds)
        print("\n".join(lines), flush=True)
    (HERE / "batch_size.md").write_text("\n".join(lines), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
