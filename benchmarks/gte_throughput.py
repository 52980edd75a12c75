"""How fast the Generated Trajectory Experiment runs: ratios of one run, written beside this file.

    python benchmarks/gte_throughput.py [--rounds 12] [--robosuite PYTHON]

* the environment, controller included, against bare `mujoco.batch.Batch.rollout` on the same model,
  simulations and threads;
* robosuite's Panda under its default operational-space controller, in an interpreter of its own
  (`--robosuite`; robosuite 1.5 does not run on MuJoCo 4), in physics steps per second and core.
"""

from __future__ import annotations

import argparse
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
from mujoco.batch import Batch

import stiction_envs  # noqa: F401

HERE = Path(__file__).parent
NSIM = 64
TARGET, ROBOSUITE_TARGET = 0.5, 10.0
STEPS = 100
"""Control steps of an environment step, as by default."""
ROBOSUITE = """
import json, sys, time
import mujoco, numpy as np, robosuite
from robosuite import load_composite_controller_config
env = robosuite.make(
    "Lift", robots="Panda", has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False,
    ignore_done=True, control_freq=20,
    controller_configs=load_composite_controller_config(robot="Panda"),
)
env.reset()
action = np.zeros_like(env.action_spec[0])
for _ in range(40):  # numba compiles
    env.step(action)
per_step, rates = round(env.control_timestep / env.model_timestep), []
for _ in range(5):
    start = time.process_time()
    for _ in range(40):
        env.step(action)
    rates.append(40 * per_step / (time.process_time() - start))
model = env.sim.model
print(json.dumps({
    "robosuite": robosuite.__version__, "mujoco": mujoco.__version__, "numpy": np.__version__,
    "nv": model.nv, "ngeom": model.ngeom, "timestep": env.model_timestep,
    "rate": float(np.median(rates)),
}))
"""


def rates(robot, threads, rounds):
    """(environment, rollout) steps/s and their ratio: the median of pairs, back to back."""
    env = gym.make_vec(f"stiction_envs:{robot}GTE-v0", num_envs=NSIM, nthread=threads)
    env.reset(seed=0, options={"trajectory": "pentagon", "stiffness": (200, 20, 0)})
    plants = [core.rig.plant for core in env.unwrapped.tiles.cores]
    plant = plants[0]
    action = np.tile(np.repeat([0.3, 30.0], 7), (NSIM, 1)).astype(np.float32)
    bare = Batch(plant.sticking.model, NSIM, threads)
    bare.state[:] = np.concatenate([p.batch.state for p in plants])
    control = np.zeros((NSIM, STEPS, plant.sticking.model.nu))
    pairs = []
    for round_ in range(rounds + 2):
        t0 = time.perf_counter()
        env.step(action)
        t1 = time.perf_counter()
        bare.rollout(STEPS, control=control, record=("qpos",))
        t2 = time.perf_counter()
        if round_ >= 2:  # the first ones compile and warm up
            pairs.append((t1 - t0, t2 - t1))
    ours, rollout = np.array(pairs).T
    count = NSIM * STEPS
    return count / np.median(ours), count / np.median(rollout), float(np.median(rollout / ours))


def robosuite_rate(python):
    """What robosuite says of itself; on one core."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    alone = {**clean, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    ran = subprocess.run(
        [python, "-c", ROBOSUITE], env=alone, check=True, capture_output=True, text=True
    )
    return json.loads(ran.stdout.splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--robosuite", metavar="PYTHON", help="interpreter that has robosuite")
    args = parser.parse_args()
    cores = os.cpu_count()
    rows, single = [], {}
    for robot in ("Panda", "Iiwa"):
        for threads in dict.fromkeys((1, cores)):
            ours, rollout, ratio = rates(robot, threads, args.rounds)
            single.setdefault(robot, ours)
            mark = "met" if ratio >= TARGET else "missed"
            rows.append(
                f"| {robot} | {threads} | {rollout:,.0f} | {ours:,.0f} | {ratio:.2f} {mark} |"
            )
            print(rows[-1])
    lines = [
        "# Throughput of the Generated Trajectory Experiment",
        "",
        f"Written by `python benchmarks/gte_throughput.py`. Python {platform.python_version()}, "
        f"MuJoCo {mujoco.__version__}, numpy {np.__version__}; {NSIM} simulations, steps of 1 ms, "
        "impedance controller, trajectories, dither, torque path and all measures included. Speeds "
        "are of this machine at that moment; compare the ratios.",
        "",
        "| robot | threads | bare `Batch.rollout` [steps/s] | `env.step` [steps/s] "
        f"| ratio (target {TARGET}) |",
        "|---|---|---|---|---|",
        *rows,
        "",
    ]
    if args.robosuite:
        found = robosuite_rate(args.robosuite)
        ratio = single["Panda"] / found["rate"]
        mark = "met" if ratio >= ROBOSUITE_TARGET else "missed"
        line = (
            f"robosuite {found['robosuite']} (MuJoCo {found['mujoco']}, numpy {found['numpy']}), "
            f"`Lift` with the Panda under its default operational-space controller, no camera: "
            f"{found['rate']:,.0f} physics steps/s per core. PandaGTE on one thread: {ratio:.0f} "
            f"times as many (target {ROBOSUITE_TARGET:g}): {mark}. The scenes differ: robosuite's "
            f"has a gripper, a table and a cube in contact ({found['nv']} degrees of freedom, "
            f"{found['ngeom']} geoms) and computes its controller and observations in Python at "
            f"{1 / found['timestep']:.0f} Hz physics; ours has 11 degrees of freedom (four elastic "
            "joints), LuGre friction and no contact, steps of 1 ms with the controller at each."
        )
        lines += [line, ""]
        print(line)
    (HERE / "gte_throughput.md").write_text("\n".join(lines), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
