"""A measured log's motion, and its noise, to simulate the log anew with something hidden in it.

    replay = replay_of(diagnosis)                 # of the user's own log
    logs = replay.logs(torque, seed)              # the same motion, another torque, new noise

The motion is the log's own behind the filter of the diagnosis, as a cubic spline: angles, speeds
and accelerations that belong together exactly. The torque is that of the nominal model along it,
without a filter, and what is hidden. The noise is what the log's own diagnosis leaves of the
measured torque, with random phases: it has the spectrum of each joint and the correlations between
joints, and nothing that follows the motion (D. Prichard, J. Theiler, "Generating surrogate data for
time series with several simultaneously measured variables", 1994). Angles get white noise of the
size of what the filter takes off them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from stiction_envs.arrays import Array
from stiction_envs.errors import StictionError
from stiction_envs.gap.causes import cause_named
from stiction_envs.gap.causes.base import DRY
from stiction_envs.gap.diagnosis import Diagnosis, diagnose_logs
from stiction_envs.gap.model_file import Nominal
from stiction_envs.gap.signals.dataset import Data, nominal_torque
from stiction_envs.gap.signals.filters import lowpass
from stiction_envs.gap.signals.spectra import resample
from stiction_envs.measured.logs.reader import JointLog

Fields = dict[str, Any]
"""Arrays (T, ...) by field of `Recording`, and what is left of torques and angles."""
LEAST_ROWS = 16  # shorter segments are left out [-]; assumed
LEAST_FRICTION = 5.0
"""Dry friction that is taken where the log shows none, over the noise [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Replay:
    """The motion of logs, the nominal torque along it, and the noise."""

    data: Data
    """The motion at even times, unfiltered; `Data.nominal` is the torque of the nominal model."""
    left: Array
    """(T, n) torque that the log's own diagnosis leaves, above the filter's band too [N·m]."""
    noise: Array
    """(n,) root mean square of it within the band, at least the noise floor [N·m]."""
    angle_noise: Array
    """(n,) standard deviation [rad]."""
    friction: Array
    """(n,) dry friction of the arm [N·m]: of the nominal model, and what the log shows besides."""
    unknown_friction: Array
    """(n,) the part of it that the nominal model lacks [N·m]."""
    sources: tuple[str, ...]
    cutoff_hz: float
    """Cutoff of the filter in the log's own diagnosis."""
    baseline: Nominal

    def logs(self, hidden: Array, seed: Sequence[int]) -> list[JointLog]:
        """Return the logs with a torque (T, n) [N·m] hidden in them, and noise."""
        rng, recording = np.random.default_rng(seed), self.data.recording
        tau = self.data.nominal + hidden
        for run in recording.runs:
            tau[run] += surrogate(self.left[run], rng)
        q = recording.q + self.angle_noise * rng.normal(size=recording.q.shape)
        out = []
        for number, source in enumerate(self.sources):
            rows = np.flatnonzero(recording.log == number)
            if len(rows) == 0:
                continue
            begins = np.flatnonzero(np.diff(recording.segment[rows])) + 1
            out.append(
                JointLog(
                    source=source,
                    t=recording.t[rows],
                    q=q[rows],
                    dq=None,
                    tau=tau[rows],
                    breaks=tuple(int(x) for x in begins),
                )
            )
        return out

    def diagnose(self, logs: Sequence[JointLog], seed: int) -> Diagnosis:
        """Diagnose logs with the same filter, arm and nominal model."""
        return diagnose_logs(
            logs,
            self.data.arm,
            nominal=replace(self.baseline, torque_sign=1, torque_lag=None),
            torque=self.data.recording.torque,
            cutoff_hz=self.cutoff_hz,
            seed=seed,
        )

    def in_band(self, x: Array) -> Array:
        """Return (T, n) behind the filter of the diagnosis."""
        out = np.array(x)
        for run in self.data.runs():
            out[run] = lowpass(out[run], 1 / self.data.dt, self.cutoff_hz)
        return out

    @cached_property
    def velocity(self) -> Array:
        """(T, n) speed that leads from each row to the next [rad/s]; 0 at the end of a segment."""
        out = np.zeros_like(self.data.q)
        for run in self.data.runs():
            out[run][:-1] = np.diff(self.data.q[run], axis=0) / self.data.dt
        return out


def surrogate(x: Array, rng: np.random.Generator) -> Array:
    """Return noise (K, n) with the spectra and the cross-spectra of ``x`` (K, n)."""
    waves = np.fft.rfft(x, axis=0)
    phases = rng.uniform(-np.pi, np.pi, (len(waves), 1))
    return np.asarray(np.fft.irfft(waves * np.exp(1j * phases), len(x), axis=0))


def replay_of(own: Diagnosis) -> Replay:
    """Return the motion and the noise of the logs of a diagnosis.

    Raises:
        StictionError: poses without time, or no segment that is long enough.
    """
    recording = own.data.recording
    for log in own.logs:
        if log.static:
            raise StictionError(f"{log.source}: poses at rest: expected joint logs to rehearse")
    explained = np.stack([own.torque(j) for j in range(own.data.n)], axis=1)
    remaining = own.data.residual - explained
    step = max(float(f"{log.step:.6g}") for log in own.logs)
    runs = zip(recording.runs, recording.path_runs, strict=True)
    parts = [_evened(own, run, path_run, remaining, step) for run, path_run in runs]
    whole = [x for x in parts if x is not None]
    if not whole:
        raise StictionError(f"{own.logs[0].source}: no segment is long enough to rehearse")
    joined: Fields = {k: np.concatenate([x[k] for x in whole]) for k in whole[0]}
    left, taken_off = joined.pop("left"), joined.pop("taken_off")
    even = replace(
        recording,
        dt=step,
        every=1,
        cutoff=np.inf,
        path_rows=np.arange(len(joined["t"])),
        path_segment=joined["segment"],
        **joined,
    )
    noise = np.maximum(np.sqrt(np.mean(np.square(remaining), axis=0)), own.data.noise)
    data = Data(
        recording=even,
        nominal=nominal_torque(even, own.baseline.friction, own.base.friction),
        rigid=even.rigid + even.arm.stated.stiffness * (even.q - even.arm.stated.springref),
        friction=own.base.friction,
        noise=own.data.noise,
    )
    known, found = _dry_friction(own)
    friction = known + np.maximum(found, 0.0)
    friction = np.where(friction > 0, friction, LEAST_FRICTION * noise)
    return Replay(
        data=own.baseline.extend(data),
        left=left,
        noise=noise,
        angle_noise=taken_off.std(axis=0),
        friction=friction,
        unknown_friction=np.maximum(friction - known, 0.0),
        sources=tuple(log.source for log in own.logs),
        cutoff_hz=recording.cutoff,
        baseline=own.baseline,
    )


def _evened(
    own: Diagnosis, run: slice, path_run: slice, remaining: Array, step: float
) -> Fields | None:
    """Return fields of `Recording` of one segment at every row of its log; None if too short."""
    recording = own.data.recording
    at, number = recording.t[run], int(recording.log[run.start])
    log = own.logs[number]
    if len(at) < LEAST_ROWS:
        return None
    (rows,) = (s for s in log.segments if log.t[s][0] <= at[0] <= log.t[s][-1])
    t, q, tau = resample(log, rows, step)
    inside = (t >= at[0]) & (t <= at[-1])
    t, q, tau = t[inside], q[inside], tau[inside]
    if len(t) < LEAST_ROWS:
        return None
    path = CubicSpline(at, recording.q[run])
    model = CubicSpline(at, recording.tau[run] - remaining[run])
    before = np.arange(path_run.start, path_run.stop) - recording.path_rows[run.start]
    finer = at[0] + recording.path_dt * before
    turning = [np.interp(t, finer, x) for x in recording.reversal_path[path_run].T]
    return {
        "t": t,
        "q": path(t),
        "dq": path(t, 1),
        "ddq": path(t, 2),
        "tau": tau,
        "reversal_path": np.stack(turning, axis=1),
        "since_log": np.interp(t, at, recording.since_log[run]),
        "since_session": np.interp(t, at, recording.since_session[run]),
        "segment": np.full(len(t), recording.segment[run.start]),
        "block": np.zeros(len(t), dtype=np.int64),
        "log": np.full(len(t), number),
        "left": tau - model(t),
        "taken_off": q - path(t),
    }


def _dry_friction(own: Diagnosis) -> tuple[Array, Array]:
    """Return (n,) dry friction of the nominal model, and (n,) of what was found [N·m]."""
    known, found = np.array(own.base.friction.level), np.zeros(own.data.n)
    for part in own.baseline.parts:
        if part.joint:
            dry = cause_named(part.cause).adds_to == DRY
            known[part.joint - 1] += part.coefficients[0] if dry else 0.0
    split = own.predictor.problem.split(own.terms, own.coefficients)
    for term, c in zip(own.terms, split, strict=True):
        if own.predictor.causes[term.cause].adds_to == DRY:
            found[term.joint] += float(c[0])
    return np.maximum(known, 0.0), found
