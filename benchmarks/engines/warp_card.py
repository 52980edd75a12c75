"""What `warp` asks of MuJoCo Warp, on a graphics card, and how fast it is there.

    python -m benchmarks.engines.warp_card [--minutes 10]    # extra warp

It writes warp_card.json, a part of the project: the page of `warp` shows it, and nobody needs a
card to make that page anew.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import numpy as np
import warp as wp
from gymnasium.utils import seeding

from benchmarks.engines.warp import (
    CARD,
    COUNTS,
    ENGINES,
    JOBS,
    PACKAGES,
    ROBOTS,
    STEPS,
    run,
    torque_line,
)
from benchmarks.engines.warp import MADE_BY as ASKED
from benchmarks.harness import Benchmark, Row
from stiction_envs.engines import warp_batch
from stiction_envs.envs.gym_env import ArmVectorEnv
from stiction_envs.envs.registration import EXPERIMENTS, register_all
from stiction_envs.friction.model import build
from stiction_envs.plant import CONTROL_DT, Plant
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.robots import load_arm

STUDY = Benchmark(
    __file__, __doc__, made_by=(*ASKED, "benchmarks/engines/warp_card.py"), packages=PACKAGES
)
TIMED = 5
"""Steps of an environment that are timed [-]."""
LEARNT = 300_000
"""Steps of the training on a card [-]."""
SETTINGS = """
[ppo]
envs = 1024
rollout = 16
batch_size = 4096

[run]
evaluation_every = 100000
"""
"""Of that training: many arms, few evaluations."""


def throughput(experiment: str, engine: str, count: int) -> Row:
    """Return control steps of all Pandas per second of the clock, in whole steps of environments.

    The first step compiles kernels and captures the graph, and is not timed.
    """
    register_all()
    make: Callable[..., ArmVectorEnv] = EXPERIMENTS[experiment].vector_class()
    env = make(count, robot="panda", engine=engine)
    ids, space, tiles = np.arange(count), env.core.action_space, env.tiles
    tiles.reset(ids, [seeding.np_random(k)[0] for k in range(count)], [None] * count)
    action = np.tile(0.3 * space.high + 0.7 * space.low, (count, 1))
    tiles.step(ids, action)
    start = time.perf_counter()
    for _ in range(TIMED):
        tiles.step(ids, action)
    seconds = time.perf_counter() - start
    return {"rate": count * TIMED * env.core.interval / CONTROL_DT / seconds}


def replayed(count: int) -> Row:
    """Return control steps of Pandas per second that are in captured steps alone [1/s]."""
    plant = Plant(build(load_arm("panda")), count, engine="warp")
    plant.run(np.zeros((count, 100, 7)))
    batch = cast("warp_batch.WarpBatch", plant.batch)
    start = time.perf_counter()
    for _ in range(STEPS):
        batch._step.zero_()  # the one command that is there
        batch._graphs["step"]()
    wp.synchronize()
    return {"rate": count * STEPS / (time.perf_counter() - start)}


def twice(robot: str, experiment: str) -> Row:
    """Return whether episodes that are run twice are the same, bit for bit."""
    a, b = (run(robot, experiment, "warp")["steps"] for _ in range(2))
    same = all(
        np.array_equal(p[0], q[0]) and p[1] == q[1]
        for x, y in zip(a, b, strict=True)
        for p, q in zip(x, y, strict=True)
    )
    return {"same": same, "steps": sum(map(len, a))}


def training(experiment: str, engine: str) -> Row:
    """Return what `stiction train` makes of a Panda in `LEARNT` steps."""
    with TemporaryDirectory() as folder:
        settings = Path(folder, "settings.toml")
        settings.write_text(SETTINGS, "utf-8")
        call = [
            sys.executable,
            "-c",
            "from stiction_envs.cli import main; raise SystemExit(main())",
        ]
        call += ["train", "panda", experiment, "--algo", "ppo", "--steps", str(LEARNT), "--json"]
        call += ["--engine", engine, "--settings", str(settings), "--out", str(Path(folder, "run"))]
        out = subprocess.run(call, check=True, capture_output=True, text=True).stdout
    result = json.loads(out)
    returns = {name: x["return"] for name, x in result["summary"].items()}
    return {"returns": returns, "steps_per_second": result["steps_per_second"]}


def speeds(engine: str) -> dict[str, Callable[[], Row]]:
    """Return what is timed of an engine, the quick ones first."""
    pairs = [(x, count) for count in COUNTS for x in ("gte", "sje")]
    rates = {f"throughput {x} {engine} {n}": partial(throughput, x, engine, n) for x, n in pairs}
    return {**rates, f"training sje {engine}": partial(training, "sje", engine)}


ON_CARD: dict[str, Callable[[], Row]] = {
    **{key: JOBS[key] for r in ROBOTS for key in (f"torques {r}", f"dithered {r}")},
    **{f"{x} {r}": JOBS[f"{x} {r}"] for x in ("sje", "gte") for r in ROBOTS},
    **{f"twice {x} panda": partial(twice, "panda", x) for x in ("sje", "gte")},
    **{f"replayed {count}": partial(replayed, count) for count in COUNTS},
    **{key: job for e in reversed(ENGINES) for key, job in speeds(e).items()},
}
"""Those for a graphics card: Warp's there, beside MuJoCo's on all processors."""


def main() -> None:
    options = STUDY.parser().parse_args()
    if not wp.is_cuda_available():
        print("no graphics card: nothing is measured")
        return
    rows = STUDY.rows(options, "card").fill(ON_CARD, lambda job: job(), minutes=options.minutes)
    for key, row in rows.items():
        if key.startswith(("torques", "dithered")):
            rows[key] = torque_line(row)
    packages = ("mujoco", "mujoco-warp", "warp-lang", "numpy")
    kept = {
        "card": wp.get_device().name,
        "processors": os.cpu_count(),
        "date": time.strftime("%Y-%m-%d"),
        "versions": {p: metadata.version(p) for p in packages},
        "rows": rows,
    }
    options.out.mkdir(parents=True, exist_ok=True)
    write_text_atomic(options.out / CARD, json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
