"""How fast the Single Joint Experiment runs: ratios measured in one run, written beside this file.

    python benchmarks/throughput.py [--rounds 9] [--skip-protocol]

* SJE against bare `mujoco.batch.Batch.rollout` on the same model, simulations and threads
  (dither, torque path, friction updates, threshold detection and servo moves included);
* a naive Gymnasium-style loop: one `MjData`, controls computed in Python at every step;
* the whole Panda protocol: 28 configurations x 13 settings x 4 iterations, wall time.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
from mujoco.batch import Batch

from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Job, configurations, load_protocol
from stiction_envs.experiments.sje.rig import BLOCK, RAMP
from stiction_envs.reporting.atomic import write_text_atomic

HERE = Path(__file__).parent
NSIM = 364


def busy_rig(threads):
    """A rig of 28 configurations x 13 settings whose ramps last longer than the measurement."""
    slow = load_protocol("panda").replace(ramp_rate=1e-3)
    experiment = SingleJointExperiment("panda", protocol=slow, nthread=threads)
    settings = [(0.0, 0.0)] + [(f, a) for f in (80.0, 50.0, 30.0, 15.0) for a in (0.1, 0.2, 0.3)]
    jobs = [Job(c, f, a) for c in configurations(7) for f, a in settings][:NSIM]
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
    return rig, ids


def sje_against_rollout(rounds, threads):
    """Median over rounds of (SJE, rollout) steps/s, each pair measured back to back."""
    rig, ids = busy_rig(threads)
    model = rig.plant.sticking.model
    bare = Batch(model, len(ids), threads)
    bare.state[:] = rig.plant.batch.state
    control = np.zeros((len(ids), BLOCK, model.nu))
    blocks, pairs = 6, []
    for round_ in range(rounds + 1):
        t0 = time.perf_counter()
        for _ in range(blocks):
            assert len(rig.advance(ids)) == 0, "a ramp ended: the measurement would shrink"
        t1 = time.perf_counter()
        for _ in range(blocks):
            bare.rollout(BLOCK, control=control, record=("qpos",))
        t2 = time.perf_counter()
        if round_:  # the first warms up
            pairs.append((t1 - t0, t2 - t1))
    steps = len(ids) * BLOCK * blocks
    sje, roll = np.array(pairs).T
    return steps / np.median(sje), steps / np.median(roll), float(np.median(roll / sje))


def naive_loop(seconds=3.0):
    """Steps/s of one `MjData` with the ramp, dither and low-pass computed in Python."""
    experiment = SingleJointExperiment("panda")
    model = experiment.sticking.model
    data = mujoco.MjData(model)
    data.qpos[experiment.sticking.motor] = experiment.poses.q[6, 0]
    y, steps, gain = np.zeros(7), 0, experiment.interface.lowpass_gain
    amplitude, frequency = np.zeros(7), np.full(7, 15.0)
    amplitude[6] = 0.8
    start = time.perf_counter()
    while time.perf_counter() - start < seconds:
        for _ in range(100):
            t = 1e-3 * steps
            command = amplitude * np.sin(2 * np.pi * frequency * t)
            command[6] += 1e-3 * t
            y += gain * (np.clip(command, y - 1.0, y + 1.0) - y)
            data.ctrl[:7] = y
            mujoco.mj_step(model, data)
            steps += 1
    return steps / (time.perf_counter() - start)


def protocol_seconds(threads):
    """Wall time of 28 configurations x 13 settings x 4 iterations, and the steps done."""
    from tuning.rules import frequencies_of
    from tuning.settings import tuning_settings
    from tuning.thesis import ThesisTuner

    experiment = SingleJointExperiment("panda", nthread=threads)
    done = {}
    with tempfile.TemporaryDirectory() as folder:
        tuner = ThesisTuner(
            experiment,
            Path(folder),
            {"benchmark": 1},
            frequencies=frequencies_of("panda"),
            scales=tuning_settings().thesis.scales,
            iterations=4,
            storage=None,
            study="benchmark",
            settings=tuning_settings(),
            progress=lambda stage, d, total: done.__setitem__(stage, d),
        )
        start = time.perf_counter()
        tuner.run_base()
        tuner.run_grid()
        wall = time.perf_counter() - start
    return wall, 1000 * sum(done.values())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--skip-protocol", action="store_true")
    args = parser.parse_args()
    sje, roll, ratio = sje_against_rollout(args.rounds, args.threads)
    naive = naive_loop()
    lines = [
        "# Throughput of the Single Joint Experiment",
        "",
        f"Written by `python benchmarks/throughput.py`. Python {platform.python_version()}, MuJoCo "
        f"{mujoco.__version__}, numpy {np.__version__}, {args.threads} threads; Panda with joints "
        f"1-4 elastic (11 degrees of freedom), {NSIM} simulations, 1 ms steps. Speeds are of this "
        "machine at that moment; compare the ratios.",
        "",
        "| | steps/s | ratio |",
        "|---|---|---|",
        f"| bare `Batch.rollout` | {roll:,.0f} | 1 |",
        f"| SJE, everything included | {sje:,.0f} | {ratio:.2f} (target 0.90) |",
        f"| naive loop, one `MjData`, Python control | {naive:,.0f} | {naive / roll:.3f} |",
        f"| SJE over naive loop | | {sje / naive:.0f}x |",
    ]
    if not args.skip_protocol:
        wall, steps = protocol_seconds(args.threads)
        lines += [
            "",
            f"Whole Panda protocol (28 configurations x 13 settings x 4 iterations): {wall:.0f} s "
            f"(target 90 s), {steps / 1e6:.1f} million steps.",
        ]
    text = "\n".join(lines) + "\n"
    write_text_atomic(HERE / "throughput.md", text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
