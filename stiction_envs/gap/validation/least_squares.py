"""The thesis's least squares (equation 3.1): friction torque against speed, a line per direction.

    m = (N Σ(q̇ τ_f) − Σq̇ Στ_f) / (N Σq̇² − (Σq̇)²)
    b = (Στ_f Σq̇² − Σq̇ Σ(q̇ τ_f)) / (N Σq̇² − (Σq̇)²)

τ_f is the measured torque less rigid-body dynamics, all on raw signals (sections 3.1 and 4.1); the
thesis takes the intercept b for the stiction band. A report compares it with the tool.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.rigid_body import inverse_dynamics
from stiction_envs.measured.logs.reader import JointLog

Array = NDArray[np.float64]
MOST_ROWS = 20_000
"""Rows of all logs together [-]; assumed: more are thinned out evenly."""
POOR = 0.1
"""R² below which the line shows nothing [-]; assumed: the thesis reports 1e-6 to 0.04."""
NOISY = 2.0
"""Least ratio of the raw friction torque's standard deviation to the filtered one's that counts as
noise [-]; assumed."""
LAG = 3e-3
"""Least delay of a logged speed that is reported [s]; assumed."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """One joint in one direction."""

    joint: int
    """From 1."""
    direction: str
    """+ or -."""
    rows: int
    intercept: float
    """b [N·m]."""
    slope: float
    """m [N·m·s/rad]."""
    r2: float
    """Coefficient of determination [-]."""


@dataclass(frozen=True, kw_only=True)
class LeastSquares:
    """The lines of all joints, and why they do not hold."""

    lines: tuple[Line, ...]
    rms: Array
    """(n,) of the filtered residual that the lines leave [N·m]; not held out."""
    breaks: dict[int, tuple[str, ...]]
    """By joint (from 1): why its lines do not hold."""

    def to_json(self) -> dict[str, object]:
        """Return JSON values."""
        return {
            "lines": [
                {
                    "joint": x.joint,
                    "direction": x.direction,
                    "rows": x.rows,
                    "intercept_nm": x.intercept,
                    "slope_nms": x.slope,
                    "r2": x.r2,
                }
                for x in self.lines
            ],
            "rms_nm": self.rms.tolist(),
            "breaks": {str(j): list(why) for j, why in self.breaks.items()},
        }


def line(speed: Array, torque: Array) -> tuple[float, float, float]:
    """Return (m, b, R²) of equation 3.1 for N samples; NaN where it has no solution.

    Args:
        speed: (N,) [rad/s].
        torque: (N,) friction torque [N·m].
    """
    n = len(speed)
    below = n * float(speed @ speed) - float(speed.sum()) ** 2
    if n < 3 or below <= 1e-12 * n * n:
        return np.nan, np.nan, np.nan
    m = (n * float(speed @ torque) - float(speed.sum() * torque.sum())) / below
    b = float(torque.sum() * (speed @ speed) - speed.sum() * (speed @ torque)) / below
    left = torque - m * speed - b
    about = torque - torque.mean()
    return m, b, 1.0 - float(left @ left) / max(float(about @ about), 1e-300)


def lines_of(speed: Array, torque: Array) -> tuple[Line, ...]:
    """Return the lines of equation 3.1, of every joint + before −.

    Args:
        speed: (K, n) [rad/s].
        torque: (K, n) friction torque [N·m].
    """
    out = []
    for j in range(speed.shape[1]):
        for name, rows in (("+", speed[:, j] > 0), ("-", speed[:, j] < 0)):
            m, b, r2 = line(speed[rows, j], torque[rows, j])
            count = int(rows.sum())
            out.append(Line(joint=j + 1, direction=name, rows=count, intercept=b, slope=m, r2=r2))
    return tuple(out)


def least_squares(logs: Sequence[JointLog], data: Data) -> LeastSquares:
    """Fit the thesis's lines to raw logs; ``data`` are the same logs after the filter."""
    speed, torque = _raw(logs, data)
    lines, rms = lines_of(speed, torque), np.empty(data.n)
    breaks: dict[int, tuple[str, ...]] = {}
    for j in range(data.n):
        mine, v, fit = lines[2 * j : 2 * j + 2], data.dq[:, j], np.zeros(len(data.t))
        for x, rows in zip(mine, (v > 0, v < 0), strict=True):
            if np.isfinite(x.slope):
                fit += np.where(rows, x.slope * v + x.intercept, 0.0)
        rms[j] = float(np.sqrt(np.mean(np.square(data.tau[:, j] - data.rigid[:, j] - fit))))
        found = _why(mine, speed[:, j], torque[:, j], data, j) + _lag(logs, j)
        if found:
            breaks[j + 1] = tuple(found)
    return LeastSquares(lines=lines, rms=rms, breaks=breaks)


def _raw(logs: Sequence[JointLog], data: Data) -> tuple[Array, Array]:
    """Return (N, n) raw speeds and friction torques; accelerations are plain differences."""
    step = max(1, sum(len(x.t) for x in logs if not x.static) // MOST_ROWS)
    speeds, torques = [], []
    for log in logs:
        for part in log.segments:
            # poses have no speeds
            if part.stop - part.start < 3 or log.static:
                continue
            t, q = log.t[part], log.q[part]
            dq = np.gradient(q, t, axis=0) if log.dq is None else log.dq[part]
            ddq = np.gradient(dq, t, axis=0)
            thin = slice(None, None, step)
            rigid = inverse_dynamics(data.pinocchio, q[thin], dq[thin], ddq[thin])
            speeds.append(dq[thin])
            torques.append(log.tau[part][thin] - rigid)
    none = np.zeros((0, data.n))
    return np.concatenate([none, *speeds]), np.concatenate([none, *torques])


def _why(lines: Sequence[Line], speed: Array, torque: Array, data: Data, j: int) -> list[str]:
    """Return why the lines of one joint do not hold."""
    out = []
    plus, minus = lines
    slowest = data.settings.motion.near_stiction_speed
    if not np.isfinite(plus.slope + minus.slope):
        return ["it does not move in both directions"]
    poor = [x for x in lines if x.r2 < POOR]
    if poor:
        worst = min(x.r2 for x in poor)
        out.append(f"R² is {worst:.2g}: scatter hides the slope; the intercept may hold")
    if plus.intercept < 0 or minus.intercept > 0:
        out.append(
            f"stiction bands of the wrong sign ({plus.intercept:+.3g}, {minus.intercept:+.3g} N·m)"
        )
    if plus.slope < 0 or minus.slope < 0:
        out.append(
            f"friction falls with speed ({plus.slope:+.3g}, {minus.slope:+.3g} N·m·s/rad), "
            "without end"
        )
    half, middle = (plus.intercept - minus.intercept) / 2, (plus.intercept + minus.intercept) / 2
    if abs(middle) > 0.5 * abs(half):
        out.append(
            f"the two bands lie about {middle:+.3g} N·m, not zero: an offset or an error of "
            "gravity counted as friction"
        )
    filtered = data.tau[:, j] - data.rigid[:, j]
    if torque.std() > NOISY * filtered.std():
        out.append(
            f"raw differentiation: the friction torque scatters by {torque.std():.3g} N·m, after "
            f"the filter by {filtered.std():.3g} N·m"
        )
    slow = float(np.mean(np.abs(speed) < slowest))
    if slow < 0.05:
        out.append(f"only {100 * slow:.1f} % of the samples are slower than {slowest:g} rad/s")
    return out


def _lag(logs: Sequence[JointLog], j: int) -> list[str]:
    """Return by how much a logged speed lags its angle, by least squares on the acceleration."""
    for log in logs:
        if log.dq is None or log.static:
            continue
        part = max(log.segments, key=lambda s: s.stop - s.start)
        q, dq = log.q[part, j], log.dq[part, j]
        h = log.step
        shift = max(1, round(0.02 / h))
        mean = np.convolve(np.gradient(q, h), np.ones(shift) / shift, "same")
        other = np.convolve(dq, np.ones(shift) / shift, "same")
        rate = np.gradient(mean, h)
        inner = slice(shift, -shift)
        power = float(rate[inner] @ rate[inner])
        if power > 0:
            lag = float(rate[inner] @ (mean - other)[inner]) / power
            if abs(lag) > LAG:
                return [f"the logged speed lags the angle by {1e3 * lag:.1f} ms"]
    return []
