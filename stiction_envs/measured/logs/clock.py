"""The robot's clock behind the logger's.

A logger stamps a sample when it receives it. The motion shows when the sample was taken: at speed v
an angle grows by v·Δt, whatever the stamp is. So from row to row

    τᵢ = Σⱼ wⱼ Δqᵢⱼ vᵢⱼ / Σⱼ wⱼ vᵢⱼ²,    var τᵢ = 1 / Σⱼ wⱼ vᵢⱼ²

is the time that passed by the motion. Here v is the slope of a cubic through some rows before and
after, which averages the jitter and follows fast motion; wⱼ = 1/(2 sⱼ²) with the noise sⱼ of the
angle. The sampling times r agree best with both stamps and motion,
min Σ (r − t)²/σ² + Σ (rᵢ − rᵢ₋₁ − τᵢ)²/var τᵢ, one banded linear system. Counted in steps of the
usual τ they give each row a tick of the robot's clock. The stamps over the ticks give the clock's
step far more exactly than a single τ does. If r lies on that clock, and the angles follow it better
than the stamps, it replaces the stamps. The two clocks may drift apart, so a stamp is compared with
those around it. No published source: derived here.

Stamps that are whole steps may be a mere count of rows: samples that were lost, or came late, leave
no mark in them, but the angles jump. There v is the median of the changes around a row, which a few
jumps do not bend, and τᵢ over the step is rounded to whole samples where all joints agree on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import savgol_filter

from stiction_envs.measured.logs.corrections import Correction, Rows

REGULAR = 1e-3
"""Stamps are a clock already if their steps are whole ones but for this share [-]; assumed."""
ON_CLOCK = 0.15
"""Largest root mean square distance from whole steps [steps]; assumed, 0.29 is chance."""
BETTER = 0.7
"""The new clock's misfit to the motion must be below this share of the stamps' [-]; assumed."""
COARSE = 0.1
"""A clock is coarse if more than this share of rows has the time of the row before [-]; assumed."""
CURVE_ORDER = 3
"""Order of the polynomials for slopes. Source: measured on sines, a line is 2 % off at 3 Hz, a
cubic 0.02 %."""
MOST_ROUNDS = 5
"""Most rounds in which the clock's step is refined; assumed."""
SETTLED = 1e-7
"""Change of the clock's step that ends the rounds, as a share of it [-]; assumed."""
CRYSTAL = 3e-4
"""Two clocks with quartz crystals agree to this share [-]; assumed."""
SEEN_DRIFT = 1e-5
"""Smallest drift of the logger's clock against the robot's that is reported [-]; assumed."""
DRIFT_ROWS = 5001
"""Rows over which the two clocks do not drift against each other; assumed."""
LEAST_ROWS = 200
"""Shorter stretches keep their stamps; assumed."""
GAP_STEPS = 5.0
"""A step of more than this many usual ones, and of `GAP_SECONDS`, is a gap; assumed."""
GAP_SECONDS = 0.025
"""See `GAP_STEPS` [s]; assumed."""
LATE = 0.75
"""Stamps that stray further may come in bursts [steps]; assumed."""
AROUND, AROUND_SECONDS = 20, 0.05
"""Rows before and after a row, and time [s], whose changes show its usual one; assumed."""
WHOLE = (0.1, 0.03)
"""Largest distance of a counted time from a whole number k of samples [samples], and per k;
assumed."""
AGREED = 0.02
"""Largest part of a row's change, weighted and squared, that one time for all joints leaves [-];
assumed."""
SHOWN = 100.0
"""Least ratio of signal to noise, squared, that shows how many samples passed [-]; assumed."""
LEAST_NOISE = 1e-9
"""Least noise of an angle [rad]; assumed: no encoder is better."""
SLOWEST_COUNTED = 0.02
"""Rows further apart do not show by their motion how many samples passed [s]; assumed."""
REGULAR_SHARE = 0.95
"""Least share of steps of whole samples behind stamps that come in bursts [-]; assumed."""
LATE_ROWS = (5, 10, 20, 40)
"""Rows after one that came late, of which one is in time again; assumed."""
TURNED = 0.5
"""Largest change of the speeds about a row over the speeds, where a row may tell its time [-];
assumed: more is an arm that stops."""
Array = NDArray[np.float64]


class Stretch(NamedTuple):
    """Rows without a gap, and the time that passed between them by the motion."""

    rows: slice
    t: Array
    """(T,) stamps [s]."""
    passed: Array
    """(T-1,) time from row to row by the motion [s]."""
    var: Array
    """(T-1,) its variance [s²]."""
    moves: NDArray[np.bool_]
    """(T-1,) whether the motion is more exact than the stamps."""

    def misfit(self, t: Array, clock: float) -> float:
        """Sum of squared distances of times (T,) from the motion, in steps of the clock."""
        # Medians of squares would hide what a few per cent of lost samples do; clip instead.
        off = (self.passed - np.diff(t))[self.moves] / clock
        return float(np.minimum(off**2, 1).sum())


def usual_step(rows: Rows) -> float:
    """Median time between rows that are apart in time, s; NaN for a single row."""
    step = np.diff(rows.t)[rows.run[1:] == rows.run[:-1]]
    step = step[step > 0]
    return float(np.median(step)) if len(step) else float("nan")


def find_gaps(t: Array, step: float) -> NDArray[np.int64]:
    """First row after each gap of the times ``t`` (T,), s, whose usual step is ``step``, s."""
    return np.flatnonzero(np.diff(t) > _gap(step)) + 1


def _gap(step: float) -> float:
    """Longest time between rows that is no gap, s."""
    return max(GAP_STEPS * step, GAP_SECONDS)


def correct_clock(rows: Rows, slowest: float = math.inf) -> tuple[list[Correction], list[str]]:
    """Make the time of ``rows`` strictly rising and, where the motion shows it, regular; in place.

    Args:
        rows: a log.
        slowest: longest usual step at which the motion is asked for the clock [s].

    Returns:
        What was corrected, and warnings.
    """
    corrections: list[Correction] = []
    warnings: list[str] = []
    equal = np.r_[False, _not_rising(rows)]
    if equal.mean() > COARSE:
        corrections.append(_spread_equal(rows))
        equal = np.r_[False, _not_rising(rows)]
    if equal.any():
        count = int(equal.sum())
        text = f"{count} rows carried the time of the row before with other values: dropped"
        corrections.append(Correction(kind="stamp", rows=count, text=text))
        # The clock may stop for several rows: keep the first of each time.
        rows.keep(~equal)
    if not usual_step(rows) > slowest:
        _rebuild(rows, corrections, warnings)
    return corrections, warnings


def _not_rising(rows: Rows) -> NDArray[np.bool_]:
    """Whether the next row of a recording has no later time: (T-1,)."""
    return (np.diff(rows.t) <= 0) & (rows.run[1:] == rows.run[:-1])


def _spread_equal(rows: Rows) -> Correction:
    """A clock coarser than the samples: rows with one stamp spaced evenly up to the next stamp."""
    new = np.r_[True, (np.diff(rows.t) > 0) | (np.diff(rows.run) != 0)]
    first = np.flatnonzero(new)
    count = np.diff(np.r_[first, len(rows.t)])
    stamp, run = rows.t[first], rows.run[first]
    width = np.r_[np.diff(stamp), 0.0]
    width[:-1][run[1:] != run[:-1]] = 0.0
    # a step over a gap, or at the end, gets the usual width of its rows
    pace = width / count
    usual = float(np.median(pace[pace > 0])) if (pace > 0).any() else 1.0
    wide = (width <= 0) | (pace > _gap(usual))
    width[wide] = usual * count[wide]
    group = np.cumsum(new) - 1
    within = np.arange(len(rows.t)) - first[group]
    rows.t = stamp[group] + width[group] * within / count[group]
    text = (
        f"up to {count.max()} rows carried one and the same time with other values: spaced evenly "
        "up to the next time"
    )
    return Correction(kind="stamp", rows=int(len(rows.t) - len(first)), text=text)


def _rebuild(rows: Rows, corrections: list[Correction], warnings: list[str]) -> None:
    step = usual_step(rows)
    if not step > 0:
        return
    cut = np.flatnonzero(rows.run[1:] != rows.run[:-1]) + 1
    cut = np.union1d(cut, find_gaps(rows.t, step))
    bounds = np.r_[0, cut, len(rows.t)].astype(int)
    parts = [slice(a, b) for a, b in pairwise(bounds) if b - a > 1]
    steps = [np.diff(rows.t[p]) / step for p in parts]
    if all(np.abs(x - np.round(x)).max() < REGULAR for x in steps):
        corrections += _recount(rows, step)
        return
    stretches = []
    for p in (p for p in parts if p.stop - p.start >= LEAST_ROWS):
        passed, var = _motion_time(rows.t[p], rows.data["q"][p], step)
        stretches.append(Stretch(p, rows.t[p], passed, var, np.sqrt(var) < 0.1 * step))
    if sum(x.moves.sum() for x in stretches) < LEAST_ROWS:
        return
    # those with enough motion to show their clock
    stretches = [x for x in stretches if x.moves.sum() >= LEAST_ROWS / 2]
    if not stretches:
        return
    usual = _mode(np.concatenate([x.passed[x.moves] for x in stretches]), step)
    clock, pace, ticks = _clock(stretches, usual)
    stray, misfit = 0.0, np.zeros(3)
    renewed: list[Array] = []
    for x, tick in zip(stretches, ticks, strict=True):
        off = x.t - tick * clock
        regular = tick * clock + np.median(off)
        whole = x.passed[x.moves] / clock
        of_clock = ((whole - np.round(whole)) ** 2).sum()
        misfit += x.misfit(x.t, clock), x.misfit(regular, clock), of_clock
        renewed.append(regular)
        # The two clocks may drift apart by seconds in half an hour.
        off = off - tick * (pace - clock)
        off = off - uniform_filter1d(off, min(len(off), DRIFT_ROWS))
        stray = max(stray, float(np.percentile(np.abs(off), 99)))
    by_stamp, by_clock, off_clock = np.sqrt(misfit / sum(x.moves.sum() for x in stretches))
    found = by_clock < BETTER * by_stamp and off_clock < ON_CLOCK and stray < 2 * clock
    late = [] if corrections or stray < LATE * clock else _count(rows, step)
    corrections += late
    if late:
        return
    if found:
        for x, regular in zip(stretches, renewed, strict=True):
            rows.t[x.rows] = regular
        _order(rows)
        gained = pace / clock - 1
        text = (
            f"robot clock rebuilt: the angles follow a regular {1e3 * clock:.6g} ms clock "
            f"(to {1e3 * by_clock * clock:.2g} ms); 99 % of the logged stamps are within "
            f"{1e3 * stray:.2g} ms of it"
        )
        if abs(gained) > SEEN_DRIFT:
            text += f", and gain {1e6 * gained:.0f} millionths on it"
        changed = sum(len(x.t) for x in stretches)
        corrections.append(Correction(kind="clock", rows=changed, text=text))
    elif by_stamp > 0.1 and off_clock < by_stamp:
        warnings.append(
            f"the logged clock jitters by {1e3 * by_stamp * clock:.2g} ms against the motion, and "
            "no regular clock was found behind it"
        )


def _recount(rows: Rows, step: float) -> list[Correction]:
    """Give rows whose stamps are whole steps the samples that passed by the motion; in place."""
    more = np.zeros(len(rows.t))
    for p in _recordings(rows, step):
        logged = np.round(np.diff(rows.t[p]) / step)
        passed, _, odd = _samples_passed(rows.data["q"][p], logged, step)
        odd &= logged < GAP_STEPS  # a gap needs no exact time
        more[p.start + 1 : p.stop] = np.where(odd, np.round(passed) - logged, 0.0)
    changed = more != 0
    if not changed.any():
        return []
    rows.t = rows.t + step * np.cumsum(more)
    text = (
        f"the stamps count rows, the angles do not follow them: at {int(changed.sum())} rows "
        f"samples were lost or came late, up to {np.abs(more).max():.0f} at once; the motion gives "
        f"the time, {step * more.sum():+.3g} s in all"
    )
    return [Correction(kind="clock", rows=int(changed.sum()), text=text)]


def _count(rows: Rows, step: float) -> list[Correction]:
    """Count the samples of rows that arrive late in bursts, if the angles are regular; in place."""
    whole = seen = 0
    counted, times = [], []
    for p in _recordings(rows, step):
        t = rows.t[p]
        passed, evident, odd = _samples_passed(rows.data["q"][p], np.ones(len(t) - 1), step)
        counts = np.where(odd, np.round(passed), 1.0)
        whole += int((np.abs(passed - counts) < WHOLE[0] + WHOLE[1] * counts)[evident].sum())
        seen += int(evident.sum())
        # where nothing moves: what was late is made up for after some rows, what was lost is not
        row = np.arange(len(t) - 1)
        ahead = [np.minimum(row + 1 + x, len(t) - 1) for x in LATE_ROWS]
        lost = np.min([np.round((t[i] - t[:-1]) / step) - (i - row) for i in ahead], axis=0)
        counts += np.where(evident | (lost < 2), 0.0, lost)
        counted.append(np.r_[0.0, np.cumsum(counts)])
        times.append(t)
    if seen < LEAST_ROWS or whole < REGULAR_SHARE * seen:
        return []
    clock = _nice(_pace(times, counted))
    off = [t - k * clock for t, k in zip(times, counted, strict=True)]
    for p, k, x in zip(_recordings(rows, step), counted, off, strict=True):
        rows.t[p] = k * clock + np.median(x)
    _order(rows)
    each = np.abs(np.concatenate([x - np.median(x) for x in off]))
    text = (
        f"robot clock rebuilt: rows arrive up to {1e3 * each.max():.2g} ms late, in bursts; the "
        f"angles follow a regular {1e3 * clock:.6g} ms clock in {whole / seen:.1%} of the steps"
    )
    return [Correction(kind="clock", rows=int((each > clock / 2).sum()), text=text)]


def _recordings(rows: Rows, step: float) -> list[slice]:
    """Rows of each recording that is long and fast enough to show its usual changes."""
    if step > SLOWEST_COUNTED:
        return []
    cut = np.flatnonzero(rows.run[1:] != rows.run[:-1]) + 1
    bounds = pairwise(np.r_[0, cut, len(rows.t)].astype(int))
    return [slice(a, b) for a, b in bounds if b - a > 2 * AROUND]


def _samples_passed(
    q: Array, logged: Array, step: float
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Samples that passed from row to row by the motion of (T, n), ``step`` [s] apart.

    ``logged`` (T-1,) are those by the stamps. Two joints or more must show it: one alone may have
    slipped.

    Returns:
        (T-1,) each: how many, where two joints show it, and where the stamps say otherwise.
    """
    change = np.diff(q, axis=0)
    # speeds before and after, so that a row in which much time passed is no part of either
    half = 2 * int(np.clip(AROUND_SECONDS / step, 5, AROUND) // 4) + 1
    near = median_filter(change, size=(half, 1), mode="nearest")
    row, last = np.arange(len(change)), len(change) - 1
    before = near[np.maximum(row - half // 2 - 1, 0)]
    after = near[np.minimum(row + half // 2 + 1, last)]
    usual = (before + after) / 2
    moved = np.abs(change)
    least = [float(x.min(initial=np.inf, where=x > 0)) / np.sqrt(12) for x in moved.T]
    noise = np.maximum(1.4826 * np.median(np.abs(change - usual), axis=0) / np.sqrt(2), least)
    noise = np.maximum(noise, LEAST_NOISE)
    seen, size = np.square(usual / noise) / 2, np.square(change / noise) / 2
    total = np.maximum(seen.sum(axis=1), 1e-300)
    passed = (change * usual / (2 * noise**2)).sum(axis=1) / total
    left = size.sum(axis=1) - passed**2 * total
    count = np.round(passed)
    evident = (total > SHOWN) & ((seen > SHOWN / 4).sum(axis=1) > 1)
    whole = (np.abs(passed - count) < WHOLE[0] + WHOLE[1] * count) & (count >= 1)
    turned = (np.square((after - before) / noise) / 2).sum(axis=1) > TURNED**2 * total
    odd = evident & whole & (count != logged) & ~turned
    return passed, evident, odd & (left < AGREED * size.sum(axis=1))


def _pace(times: Sequence[Array], ticks: Sequence[NDArray[np.number]]) -> float:
    """Return the time per tick [s] of all stretches, each from its own start."""
    top, bottom = 0.0, 0.0
    for t, k in zip(times, ticks, strict=True):
        x = k - k.mean()
        top += float(x @ (t - t.mean()))
        bottom += float(x @ x)
    return top / bottom


def _nice(clock: float) -> float:
    """Return a clock's step [s], of whole 50 µs where that agrees with it as crystals do."""
    whole = round(clock / 5e-5) * 5e-5
    return whole if whole > 0 and abs(clock / whole - 1) < CRYSTAL else clock


def _clock(stretches: list[Stretch], guess: float) -> tuple[float, float, list[NDArray[np.int64]]]:
    """Step of the robot's clock, that of its ticks in logged time, s, and ticks of each row.

    The guess of the step is good to some per cent, s.
    """
    stamps = [x.t for x in stretches]
    times = [_sampled(x, guess) for x in stretches]
    # A step that is wrong by a hundredth still counts how many passed from row to row.
    counted = [np.r_[0, np.cumsum(np.round(np.diff(x) / guess))].astype(np.int64) for x in times]
    clock = _pace(stamps, counted) if sum(k[-1] for k in counted) > 0 else guess
    ticks = counted
    for _ in range(MOST_ROUNDS):
        ticks = [_ticks(x, clock) for x in times]
        before, clock = clock, _pace(stamps, ticks)
        if abs(clock / before - 1) < SETTLED:
            break
    return _nice(clock), clock, ticks


def _motion_time(t: Array, q: Array, step: float) -> tuple[Array, Array]:
    """Time passed from row to row by the motion, and its variance: (T-1,) each, s and s²."""
    half = int(np.clip(GAP_SECONDS / step, 5, 25))
    width = 2 * half + 1
    # Curves over the row number, not over the jittery stamps: the slopes' ratio is not biased.
    pace = savgol_filter(t - t[0], width, CURVE_ORDER, deriv=1, mode="nearest")
    top, bottom = np.zeros((2, len(t) - 1))
    logged = np.diff(t)
    usual = np.median(logged)
    for angle in q.T:
        slope = savgol_filter(angle - angle[0], width, CURVE_ORDER, deriv=1, mode="nearest") / pace
        v = 0.5 * (slope[1:] + slope[:-1])
        change = np.diff(angle)
        moved = np.abs(change)
        if not moved.any():
            continue
        noise = min(float(np.median(np.abs(change - v * x))) for x in (usual, logged))
        noise = max(1.4826 * noise / np.sqrt(2), moved[moved > 0].min() / np.sqrt(12))
        weight = 1 / (2 * noise**2)
        top += weight * change * v
        bottom += weight * v * v
    known = bottom > 0
    # Where nothing moves there are only the stamps, good to little more than a step.
    passed = np.where(known, top / np.where(known, bottom, 1.0), logged)
    var = np.where(known, 1 / np.where(known, bottom, 1.0), np.inf) + (0.02 * step) ** 2
    slow = var > (0.5 * step) ** 2
    passed[slow], var[slow] = logged[slow], (0.5 * step) ** 2
    # The slope reaches over the ends of the stretch.
    var[:half] = var[len(var) - half :] = (0.5 * step) ** 2
    passed[:half], passed[len(passed) - half :] = logged[:half], logged[len(passed) - half :]
    return passed, var


def _mode(passed: Array, step: float) -> float:
    """Most usual time between samples, s."""
    clock = float(np.median(passed))
    clock = clock if clock > 0.2 * step else step
    for width in (0.25, 0.1, 0.1):
        near = passed[np.abs(passed / clock - 1) < width]
        clock = float(np.median(near)) if len(near) else clock
    return clock


def _sampled(x: Stretch, clock: float) -> Array:
    """When each row was sampled, by stamps and motion together, from the first stamp: (T,), s."""
    sigma = 0.4 * clock
    weight = 1 / x.var
    band = np.zeros((2, len(x.t)))
    band[1] = 1 / sigma**2
    band[1, 1:] += weight
    band[1, :-1] += weight
    band[0, 1:] = -weight
    right = (x.t - x.t[0]) / sigma**2
    right[1:] += weight * x.passed
    right[:-1] -= weight * x.passed
    return np.asarray(solveh_banded(band, right))


def _ticks(sampled: Array, clock: float) -> NDArray[np.int64]:
    """Number of the clock's tick at which each row was sampled, strictly rising: (T,)."""
    sampled = sampled / clock
    # The two clocks drift against each other: the phase is followed, some seconds at a time.
    turn = np.exp(2j * np.pi * sampled)
    width = min(len(sampled), 501)
    phase = np.angle(uniform_filter1d(turn.real, width) + 1j * uniform_filter1d(turn.imag, width))
    ticks = np.round(sampled - np.unwrap(phase) / (2 * np.pi)).astype(np.int64)
    row = np.arange(len(sampled))
    return np.maximum.accumulate(ticks - row) + row


def _order(rows: Rows) -> None:
    """Stretches that were moved by a step or two must still follow one another."""
    for i in np.flatnonzero(_not_rising(rows)):
        rows.t[i + 1 :] += rows.t[i] - rows.t[i + 1] + usual_step(rows)
