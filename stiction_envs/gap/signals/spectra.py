"""Spectra of joint logs: where the signal ends, how much noise there is, which joints move.

A spectrum S stops falling where noise takes over. This is the lowest frequency with S(f) ≤ 2·median
of S over the three octaves above, where signal and noise are equal, or from which S stays within a
factor of 3 for two octaves, if the noise itself ends above. A sharp low-pass where signal and noise
are equal has the least mean square error (Wiener, "Extrapolation, Interpolation, and Smoothing of
Stationary Time Series", 1949).
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.filters import ORDER, spectrum
from stiction_envs.measured.logs.reader import JointLog
from stiction_envs.measured.motion_thresholds import MOVER_RATIO

PERIODS = 6.0
"""Least length of a segment in periods of the cutoff [-]; assumed."""
MOST_ROWS = 300000
"""Most rows of all logs that are used [-]; assumed, to limit the time for long logs."""
HARMONICS = 10.0
"""Harmonic of the motion that the band contains at least [-], because dry friction jumps at each
reversal; assumed."""
ACCURATE = 0.003
"""Allowed noise of the acceleration as a share of its root mean square [-]; assumed: inertia needs
a tenth of usual torques, so that its noise is a tenth of what good sensors have. More looks like a
delay of 5 ms or a soft spring, which smooth it."""
HIGHEST = 0.1
"""Largest cutoff as a share of the rate of new values [-]; assumed."""
WIDE, GAP_VALUES = 0.01, 2.5
"""Part of the time that is in gaps which count [-], and values that one of them is worth: a cutoff
of a tenth of the rate is a quarter of a period in the gap; assumed."""
LOWEST = 1.0
"""Smallest cutoff that is chosen [Hz]; assumed."""
MOTION_SHARE = 0.95
"""The motion's band ends where this share of the speeds' power lies below [-]; assumed."""
STRETCHES = 6
"""Number of parts of a longer segment, spread over it [-]; assumed."""


class Spectra:
    """Spectra of angles and torques over all segments of some logs."""

    def __init__(self, logs: Sequence[JointLog], steps: Sequence[float]) -> None:
        self.rate = 1 / max(steps)
        self.effective = effective_rate(logs)
        self.n = logs[0].n
        segments = [
            (log.t[s][-1] - log.t[s][0], k, s)
            for k, log in enumerate(logs)
            for s in log.segments
            if s.stop - s.start >= 64
        ]
        self.longest = max((seconds for seconds, _, _ in segments), default=0.0)
        pieces = [(seconds, k, part) for seconds, k, s in segments for part in _samples_of(s)]
        # The longest segments are sufficient, and limit the time for long logs.
        pieces.sort(key=lambda p: -p[0])
        length = int(self.rate * min(4.0, self.longest / 4))
        self.length = max(16, length // 2 * 2)
        self.f = np.fft.rfftfreq(self.length, 1 / self.rate)
        self.q = np.zeros((len(self.f), self.n))
        self.tau = np.zeros((len(self.f), self.n))
        self.grain = np.full(self.n, np.inf)
        """Smallest step of each torque, N·m."""
        motion: list[tuple[Array, Array]] = []
        used = 0
        for _, k, rows in pieces:
            if used >= MOST_ROWS:
                break
            t, q, tau = resample(logs[k], rows, 1 / self.rate)
            if len(t) < 2 * self.length:
                continue
            used += len(t)
            # Differences keep the strong slow motion from leaking into high frequencies.
            q_rows, tau_rows = np.ascontiguousarray(q.T), np.ascontiguousarray(tau.T)
            self.q += len(t) * self._welch(np.diff(q_rows, 2), 4)
            self.tau += len(t) * self._welch(np.diff(tau_rows), 2)
            for j in range(self.n):
                change = np.abs(np.diff(logs[k].tau[rows, j]))
                change = change[change > 0]
                if len(change):
                    self.grain[j] = min(self.grain[j], float(np.percentile(change, 1)))
            motion.append(_spread_power(np.diff(q, axis=0) * self.rate, self.rate))
        self.empty = not used
        for array in (self.q, self.tau):
            array /= max(used, 1)
        self.knee_q = [self._knee(x, self.f[1]) for x in self.q.T]
        self.movers, self.motion_hz, bent = _motion(motion, self.knee_q)
        self.accurate = [self._accurate(j, bent[j]) for j in range(self.n)]
        self.knee_tau = [self._knee(x, max(self.f[1], self.motion_hz)) for x in self.tau.T]
        self.grain[~np.isfinite(self.grain)] = 0.0

    def choose(self, notes: list[str]) -> float:
        """Return the cutoff [Hz] of a low-pass that keeps the signal and removes noise."""
        highest = HIGHEST * self.effective
        if self.empty:
            notes.append(f"cutoff {highest:.3g} Hz: too short for a spectrum")
            return highest
        f_q = float(np.median([self.knee_q[j] for j in self.movers]))
        f_ddq = float(np.median([self.accurate[j] for j in self.movers]))
        f_tau = float(np.median([self.knee_tau[j] for j in self.movers]))
        lowest = max(LOWEST, min(PERIODS / self.longest, highest))
        limits = {
            "the angles' noise begins there": max(f_q, f_ddq, HARMONICS * self.motion_hz),
            "the torques' noise begins there": max(f_tau, HARMONICS * self.motion_hz),
            f"{HIGHEST:g} of the {self.effective:.4g} new values a second": highest,
        }
        why = min(limits, key=lambda x: limits[x])
        cutoff = max(limits[why], lowest)
        if cutoff == lowest:
            why = "the least that is useful"
        elif cutoff == HARMONICS * self.motion_hz:
            why = f"{HARMONICS:g} times the motion's frequencies"
        notes.append(
            f"cutoff {cutoff:.3g} Hz, zero phase: {why} ({MOTION_SHARE:.0%} of the motion is below "
            f"{self.motion_hz:.2g} Hz, accelerations are good up to {f_ddq:.3g} Hz, the torques' "
            f"noise begins at {f_tau:.3g} Hz)"
        )
        return cutoff

    def noise(self, cutoff: float) -> Array:
        """Return (n,) standard deviation of the filtered torques' noise [N·m].

        The spectrum just above the filter's band, and above where it stops falling, is taken to
        continue within the band.
        """
        # |H|² of the digital Butterworth low-pass, which runs twice
        frequency = np.arange(8192) / 8192 / 2
        bent = np.tan(np.pi * frequency) / np.tan(np.pi * min(cutoff / self.rate, 0.49))
        gain = 1 / (1 + bent ** (2 * ORDER))
        rounding, nyquist = self.grain / np.sqrt(12), self.rate / 2
        width = float(np.mean(gain**2)) * self.rate / 2
        inside = np.zeros(self.n)
        for j, knee in enumerate(self.knee_tau if not self.empty else ()):
            # A spectrum that falls to the end hides its noise; the part next to the band bounds it.
            start = max(cutoff, knee) if knee < nyquist else cutoff
            low = min(1.5 * start, 0.6 * nyquist)
            above = (self.f >= low) & (self.f <= min(2 * low, 0.9 * nyquist))
            inside[j] = np.sqrt(float(np.median(self.tau[above, j])) * width)
        return np.maximum(inside, rounding * np.sqrt(width / nyquist))

    def rounded(self) -> Bools:
        """Return (n,) whether each torque contains only rounding at high frequencies."""
        if self.empty:
            return np.zeros(self.n, dtype=bool)
        top = (self.f > 0.6 * self.f[-1]) & (self.f < 0.95 * self.f[-1])
        rounding = self.grain**2 / 12 / self.f[-1]
        return np.asarray(np.median(self.tau[top], axis=0) < 4 * rounding)

    def _welch(self, differences: Array, power: int) -> Array:
        """Return (f, n) the spectrum of a signal whose differences (n, K) of an order are given."""
        # The median over windows ignores the few that hold a jump or a collision.
        median = differences.shape[-1] >= 4 * self.length
        density = spectrum(differences, self.rate, self.length, median=median)[1]
        gain = 2 * np.sin(np.pi * self.f / self.rate)
        gain[0] = gain[1]
        return np.asarray(density / gain**power).T

    def _accurate(self, joint: int, acceleration: float) -> float:
        """Return the cutoff [Hz] with the allowed noise of a joint's RMS acceleration [rad/s²]."""
        above = (self.f >= self.knee_q[joint]) & (self.f <= 0.95 * self.f[-1])
        noise = float(np.median(self.q[above, joint])) if above.any() else 0.0
        if noise <= 0:
            return float(self.f[-1])
        square = (ACCURATE * acceleration) ** 2
        return float(min((5 * square / noise / (2 * np.pi) ** 4) ** 0.2, self.f[-1]))

    def _knee(self, spectrum: Array, start: float) -> float:
        """Return the frequency, at least ``start``, above which the spectrum does not fall [Hz]."""
        edges = np.searchsorted(self.f, self.f[1] * 2 ** (np.arange(60) / 3) * (1 - 1e-9))
        edges = np.unique(edges[edges < 0.95 * len(self.f)])
        # By thirds of octaves, so that the highest octave does not dominate the median.
        level = np.array([np.median(spectrum[a:b]) for a, b in pairwise(edges)])
        for i in range(len(level) - 3):
            low = float(self.f[edges[i]])
            near = level[i : i + 7]
            flat = len(near) == 7 and near.max() <= 3 * near.min()
            if low >= start and (flat or level[i] <= 2 * np.median(level[i + 1 : i + 10])):
                return low
        return float(self.f[-1])


def effective_rate(logs: Sequence[JointLog]) -> float:
    """Return the rate of new values [Hz], or of gaps that hold part `WIDE` of the time."""
    steps = np.sort(np.concatenate([np.diff(log.t[s]) for log in logs for s in log.segments]))
    within = int((np.cumsum(steps) <= (1 - WIDE) * steps.sum()).sum())
    widest = float(steps[min(within, len(steps) - 1)])
    usual = max(log.held * log.step for log in logs)
    return float(f"{min(1 / usual, GAP_VALUES / widest):.6g}")


def _samples_of(rows: slice) -> list[slice]:
    """Return the rows, or stretches spread over them if there are too many."""
    length = rows.stop - rows.start
    if length <= MOST_ROWS:
        return [rows]
    part = MOST_ROWS // STRETCHES
    starts = np.linspace(rows.start, rows.stop - part, STRETCHES).astype(int)
    return [slice(int(a), int(a) + part) for a in starts]


def by_column(make: Callable[[Array], Array], x: Array) -> Array:
    """Return the results of a function of each column (K,) of (K, n)."""
    return np.stack([make(column) for column in x.T], axis=1)


def resample(log: JointLog, rows: slice, step: float) -> tuple[Array, Array, Array]:
    """Return even times (K,) [s], and angles [rad] and torques [N·m] (K, n) at them."""
    t, q, tau = log.t[rows], log.q[rows], log.tau[rows]
    count = int(np.floor((t[-1] - t[0]) / step * (1 + 1e-9))) + 1
    even = t[0] + step * np.arange(count)
    if count == len(t) and np.abs(t - even).max() < 0.01 * step:
        return even, q, tau
    # A spline through rows that nearly coincide would overshoot.
    smooth = np.diff(t).min() > 0.5 * step

    def evened(x: Array) -> Array:
        return np.asarray(CubicSpline(t, x)(even) if smooth else np.interp(even, t, x))

    return even, by_column(evened, q), by_column(evened, tau)


def _spread_power(v: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies [Hz] and the part of Σ v² of each speed ``v`` (K, n) at them."""
    window = np.hanning(len(v))[:, None]
    power = np.abs(np.fft.rfft((v - v.mean(axis=0)) * window, axis=0)) ** 2
    return np.asarray(np.fft.rfftfreq(len(v), 1 / rate)), 2 * power / np.sum(window**2)


def _motion(
    pieces: Sequence[tuple[Array, Array]], most: Sequence[float]
) -> tuple[Index, float, Array]:
    """Return joints that move, the end of their band [Hz], and RMS accelerations [rad/s²].

    Each joint counts up to the frequency in ``most`` [Hz], where its noise begins.
    """
    if not pieces:
        return np.arange(len(most)), 0.0, np.zeros(len(most))
    f = np.concatenate([f for f, _ in pieces])
    power = np.concatenate([p for _, p in pieces])
    power[f[:, None] > np.asarray(most)] = 0.0
    each = power.sum(axis=0)
    order = np.argsort(f, kind="stable")
    total = np.cumsum(power.sum(axis=1)[order])
    movers = np.flatnonzero(each >= MOVER_RATIO**2 * each.max())
    end = float(f[order][np.searchsorted(total, MOTION_SHARE * total[-1])])
    rows = sum(2 * len(f) for f, _ in pieces)
    return movers, end, np.sqrt((power * (2 * np.pi * f[:, None]) ** 2).sum(axis=0) / rows)
