"""Logs with the defects of real robots' logs, all at once: made by code, from no real log.

What is wrong in each was found in logs of a Panda (a PC's clock, repeated rows, half-written
samples, filtered speeds, angles as commanded) and of an iiwa (runs in one file, torques of the
opposite sign that come late, filtered speeds).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.harness import MEASURED
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.hidden.examples import log_csv
from stiction_envs.robots import load_arm
from tests.measured.logs.bad_logs import put

Array = NDArray[np.float64]


def real(name: str) -> Path:
    """Return a measured log, which is there on some machines only."""
    path = MEASURED / name
    if not path.exists():
        pytest.skip(f"measured log {name} is not here")
    return path


def low_passed(x: Array, seconds: float, rate: float) -> Array:
    """First-order low-pass along the rows."""
    k = np.exp(-1 / rate / seconds)
    return lfilter([1 - k], [1, -k], x, axis=0, zi=k * x[:1])[0]


@dataclass(frozen=True)
class Shaken:
    """File of `excitation`, and its number of rows with each defect."""

    path: Path
    repeats: int
    old_q: int
    halves: int


def fourier(t: Array, n: int, seed: int) -> tuple[Array, Array, Array]:
    """Angles, speeds and accelerations (T, n) of five harmonics of 0.075 Hz about zero."""
    rng = np.random.default_rng(seed)
    w = 2 * np.pi * 0.075 * np.arange(1, 6)
    size, phase = rng.normal(size=(5, n)), rng.uniform(0, 2 * np.pi, (5, n))
    angle = t[:, None, None] * w[:, None] + phase
    q = (size * np.sin(angle)).sum(axis=1)
    dq = (size * w[:, None] * np.cos(angle)).sum(axis=1)
    ddq = -(size * w[:, None] ** 2 * np.sin(angle)).sum(axis=1)
    scale = 0.6 / np.abs(q).max(axis=0)
    return q * scale, dq * scale, ddq * scale


def excitation(path: Path) -> Shaken:
    """A Panda that moves all joints for 20 s, as a PC beside it logs: with every defect."""
    arm, rate = load_arm("panda"), 1000.0
    rng = np.random.default_rng(11)
    t = np.arange(20_000) / rate
    q, dq, ddq = fourier(t, arm.n, 1)
    q = q + arm.rest
    tau = inverse_dynamics(arm.pinocchio(), q, dq, ddq) + 0.4 * np.tanh(dq / 0.01)
    tau += 0.03 * rng.normal(size=q.shape)
    dq_seen = dq + 1e-3 * rng.normal(size=q.shape)
    # the arm shakes at 18 to 30 Hz: speeds and torques show it, the angles are those commanded
    hz, phase = rng.uniform(18, 30, 40), rng.uniform(0, 2 * np.pi, 40)
    shake = np.sin(2 * np.pi * np.outer(t, hz) + phase).sum(axis=1)[:, None]
    tau += 0.05 * shake
    dq_seen = low_passed(dq_seen + 0.005 * shake, 0.005, rate)
    # some samples are lost, some written twice; of 120 the angles are a sample old, for half of
    # these a row with the new ones follows
    rows = np.flatnonzero(rng.random(len(t)) > 0.02)
    old, half = np.split(50 + 100 * rng.permutation(len(rows) // 100 - 1)[:120], 2)
    twice = np.setdiff1d(
        rng.choice(len(rows) - 2, 1000, replace=False), (old[:, None] + [-1, 0, 1])
    )
    twice = np.setdiff1d(twice, (half[:, None] + [-1, 0, 1]))
    order = np.sort(np.r_[np.arange(len(rows)), half, twice])
    first = np.searchsorted(order, np.r_[old, half])
    angles = q[rows][order]
    angles[first] = q[rows][order[first] - 1]
    clock = t[rows][order] + 4e-4 * rng.random(len(order))
    again = np.r_[False, order[1:] == order[:-1]]
    clock[again] = clock[np.flatnonzero(again) - 1] + 1e-4
    text = log_csv(clock, q=angles, dq=dq_seen[rows][order], tau=tau[rows][order])
    return Shaken(put(path, text), len(twice), len(old), len(half))


def sweeps(
    path: Path, joint: int, *, sign: float = -1.0, lag: float = 0.12, seconds: float = 8.0
) -> Path:
    """An iiwa 14 that turns one joint (from 1) to and fro at eight speeds, a run each.

    Logged torques have a ``sign`` and come by ``lag`` [s] later than the angles; a run takes some
    seconds.
    """
    arm, rate = load_arm("iiwa14"), 200.0
    rng = np.random.default_rng(joint)
    t = np.arange(round(seconds * rate)) / rate
    parts, runs = [], ["run,segment"]
    for speed in np.linspace(0.1, 0.45, 8):
        reach = min(0.7, speed * seconds / 4)
        there = reach * np.abs((speed * t / reach) % 2 - 1)
        swing = np.convolve(np.pad(there, 30, mode="edge"), np.ones(61) / 61, "valid")
        q = np.zeros((len(t), arm.n))
        q[:, joint - 1] = swing - reach / 2
        dq = np.gradient(q, t, axis=0)
        ddq = np.gradient(dq, t, axis=0)
        tau = inverse_dynamics(arm.pinocchio(), q, dq, ddq) + np.tanh(dq / 0.01) + 0.5 * dq
        tau = np.stack([np.interp(t - lag, t, x) for x in tau.T], axis=1)
        tau = sign * (tau + 0.01 * rng.normal(size=q.shape))
        dq = low_passed(dq, 0.02, rate)
        q = q + 1e-6 * rng.normal(size=q.shape)
        parts.append(np.column_stack([t, q, dq, tau]))
        runs += [f"j{joint}_v{speed:.2f},0"] * len(t)
    t, q, dq, tau = np.split(np.concatenate(parts), np.cumsum([1, arm.n, arm.n]), axis=1)
    rows = log_csv(t[:, 0], q=q, dq=dq, tau=tau).splitlines()
    return put(path, "\n".join(map(",".join, zip(runs, rows, strict=True))) + "\n")
