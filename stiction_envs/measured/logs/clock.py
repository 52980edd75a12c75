"""The robot's clock behind the logger's.

A logger stamps a sample when it hears of it. What the arm did in between says when the sample was
taken: at speed v an angle grows by v·Δt, whatever the stamp says. So from row to row

    τᵢ = Σⱼ wⱼ Δqᵢⱼ vᵢⱼ / Σⱼ wⱼ vᵢⱼ²,    var τᵢ = 1 / Σⱼ wⱼ vᵢⱼ²

is the time that passed by the motion (v: slope of a cubic through some rows before and after, which
averages the jitter away and follows fast motion; wⱼ = 1/(2 sⱼ²), sⱼ noise of the angle). The
sampling times r are those that agree best with both stamps and motion,
min Σ (r − t)²/σ² + Σ (rᵢ − rᵢ₋₁ − τᵢ)²/var τᵢ, one banded linear system. Counted in steps of the
usual τ they give each row a tick of the robot's clock, and the stamps over the ticks give the
clock's step, far more exactly than any single τ does. If r lies on that clock, and the angles
follow it better than the stamps, it replaces the stamps; else these stay. The two clocks may drift
apart: what counts is how far a stamp is from those around it. No published source: derived here.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_filter

from stiction_envs.measured.logs.corrections import Correction, Rows

REGULAR = 0.001
"""Stamps whose steps are whole ones but for this share are a clock already [-]."""
ON_CLOCK = 0.15
"""Root mean square distance from whole steps [steps]; 0.29 is chance."""
BETTER = 0.7
"""The new clock's misfit to the motion must be below this share of the stamps' [-]."""
COARSE = 0.1
"""Share of rows with the time of the row before from which on the clock is coarse [-]."""
CURVE_ORDER = 3
"""Order of the polynomials for slopes: a line is 2 % off at 3 Hz, a cubic 0.02 %."""
MOST_ROUNDS = 5
"""In which the clock's step is refined."""
SETTLED = 1e-07
"""Change of the clock's step that ends the rounds, as a share of it [-]."""
CRYSTAL = 0.0003
"""Two clocks with quartz crystals agree to this share [-]."""
SEEN_DRIFT = 1e-05
"""Drift of the logger's clock against the robot's from which on it is told [-]."""
DRIFT_ROWS = 5001
"""Rows over which the two clocks do not drift against each other."""
LEAST_ROWS = 200
"""Shorter stretches keep their stamps."""
GAP_STEPS = 5.0
"""A step of more than this many usual ones, and of `GAP_SECONDS`, is a gap."""
GAP_SECONDS = 0.025
"""See `GAP_STEPS` [s]."""
Passed = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Time passed from row to row by the motion, and its variance: (T-1,) each, s and s²."""


def usual_step(rows: Rows) -> float:
    """Median time between rows that are apart in time, s; NaN for a single row."""
    step = np.diff(rows.t)[rows.run[1:] == rows.run[:-1]]
    step = step[step > 0]
    return float(np.median(step)) if len(step) else float("nan")


def find_gaps(t: NDArray[np.float64], step: float) -> NDArray[np.int64]:
    """First row after each gap of the times ``t`` (T,), s, whose usual step is ``step``, s."""
    return np.flatnonzero(np.diff(t) > _gap(step)) + 1


def _gap(step: float) -> float:
    """Longest time between rows that is no gap, s."""
    return max(GAP_STEPS * step, GAP_SECONDS)


def correct_clock(rows: Rows) -> tuple[list[Correction], list[str]]:
    """Make the time of ``rows`` strictly rising and, where the motion shows it, regular; in place.

    Returns:
        What was corrected, and warnings.
    """
    corrections: list[Correction] = []
    warnings: list[str] = []
    same_run = rows.run[1:] == rows.run[:-1]
    equal = np.r_[False, (np.diff(rows.t) <= 0) & same_run]
    if equal.mean() > COARSE:
        corrections.append(_spread_equal(rows))
        equal = np.r_[False, (np.diff(rows.t) <= 0) & same_run]
    if equal.any():
        count = int(equal.sum())
        text = f"{count} rows carried the time of the row before with other values: dropped"
        corrections.append(Correction(kind="stamp", rows=count, text=text))
        # The clock may stop for several rows: keep the first of each time.
        rows.keep(~equal)
    _rebuild(rows, corrections, warnings)
    return corrections, warnings


def _spread_equal(rows: Rows) -> Correction:
    """A clock coarser than the samples: rows with one stamp spaced evenly up to the next stamp."""
    new = np.r_[True, (np.diff(rows.t) > 0) | (np.diff(rows.run) != 0)]
    first = np.flatnonzero(new)
    count = np.diff(np.r_[first, len(rows.t)])
    stamp, run = rows.t[first], rows.run[first]
    width = np.r_[np.diff(stamp), 0.0]
    width[:-1][run[1:] != run[:-1]] = 0.0
    # A step over a gap, or none at the end, is as wide as its rows usually need.
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
        return
    parts = [p for p in parts if p.stop - p.start >= LEAST_ROWS]
    evidence = [_motion_time(rows.t[p], rows.data["q"][p], step) for p in parts]
    moving = [np.sqrt(var) < 0.1 * step for _, var in evidence]
    if sum(m.sum() for m in moving) < LEAST_ROWS:
        return
    parts, evidence, moving = _long_enough(parts, evidence, moving)
    if not parts:
        return
    tau = np.concatenate([e[m] for (e, _), m in zip(evidence, moving, strict=True)])
    clock, pace, ticks = _clock([rows.t[p] for p in parts], evidence, _mode(tau, step))
    stray, changed, misfit = 0.0, 0, np.zeros(3)
    renewed: list[tuple[slice, NDArray[np.float64]]] = []
    for part, (passed, _), moves, tick in zip(parts, evidence, moving, ticks, strict=True):
        logged = rows.t[part]
        regular = tick * clock
        off = logged - regular
        regular = regular + np.median(off)
        whole = passed[moves] / clock
        # Medians of squares would hide what a few per cent of lost samples do; clip instead.
        misfit += (
            np.minimum(((passed - np.diff(logged))[moves] / clock) ** 2, 1).sum(),
            np.minimum(((passed - np.diff(regular))[moves] / clock) ** 2, 1).sum(),
            ((whole - np.round(whole)) ** 2).sum(),
        )
        renewed.append((part, regular))
        # The two clocks may drift apart by seconds in half an hour.
        near = uniform_filter1d(off - tick * (pace - clock), min(len(off), DRIFT_ROWS))
        off = off - tick * (pace - clock) - near
        stray = max(stray, float(np.percentile(np.abs(off), 99)))
        changed += len(logged)
    count = sum(m.sum() for m in moving)
    by_stamp, by_clock, off_clock = np.sqrt(misfit / count)
    if by_clock < BETTER * by_stamp and off_clock < ON_CLOCK and stray < 2 * clock:
        for part, regular in renewed:
            rows.t[part] = regular
        _order(rows)
        gained = pace / clock - 1
        text = (
            f"robot clock rebuilt: the angles follow a regular {1e3 * clock:.6g} ms clock "
            f"(to {1e3 * by_clock * clock:.2g} ms); 99 % of the logged stamps are within "
            f"{1e3 * stray:.2g} ms of it"
        )
        if abs(gained) > SEEN_DRIFT:
            text += f", and gain {1e6 * gained:.0f} millionths on it"
        corrections.append(Correction(kind="clock", rows=changed, text=text))
    elif by_stamp > 0.1 and off_clock < by_stamp:
        warnings.append(
            f"the logged clock jitters by {1e3 * by_stamp * clock:.2g} ms against the motion, and "
            "no regular clock was found behind it"
        )


def _long_enough(
    parts: list[slice],
    evidence: list[Passed],
    moving: list[NDArray[np.bool_]],
) -> tuple[list[slice], list[Passed], list[NDArray[np.bool_]]]:
    """Stretches with enough motion to say something of their clock."""
    good = [k for k, m in enumerate(moving) if m.sum() >= LEAST_ROWS / 2]
    return [parts[k] for k in good], [evidence[k] for k in good], [moving[k] for k in good]


def _clock(
    stamps: list[NDArray[np.float64]], evidence: list[Passed], guess: float
) -> tuple[float, float, list[NDArray[np.int64]]]:
    """Step of the robot's clock, that of its ticks in logged time, s, and ticks of each row.

    Args:
        stamps: logged times of each stretch, (T,), s.
        evidence: time passed by the motion and its variance, (T-1,) each, s and s².
        guess: step, good to some per cent, s.
    """

    def slope(ticks: list[NDArray[np.int64]]) -> float:
        top, bottom = 0.0, 0.0
        for t, k in zip(stamps, ticks, strict=True):
            x = k - k.mean()
            top += float(x @ (t - t.mean()))
            bottom += float(x @ x)
        return top / bottom

    times = [_sampled(t, *e, guess) for t, e in zip(stamps, evidence, strict=True)]
    # A step that is wrong by a hundredth still says how many of them passed from row to row.
    counted = [np.r_[0, np.cumsum(np.round(np.diff(x) / guess))].astype(np.int64) for x in times]
    clock = slope(counted) if sum(k[-1] for k in counted) > 0 else guess
    ticks = counted
    for _ in range(MOST_ROUNDS):
        ticks = [_ticks(x, clock) for x in times]
        before, clock = clock, slope(ticks)
        if abs(clock / before - 1) < SETTLED:
            break
    return _nice(clock, CRYSTAL), clock, ticks


def _motion_time(t: NDArray[np.float64], q: NDArray[np.float64], step: float) -> Passed:
    """Time passed from row to row by the motion, and its variance: (T-1,) each, s and s²."""
    half = int(np.clip(GAP_SECONDS / step, 5, 25))
    width = 2 * half + 1
    # Curves over the row number, not over the jittery stamps: the slopes' ratio is not biased.
    pace = savgol_filter(t - t[0], width, CURVE_ORDER, deriv=1, mode="nearest")
    top = np.zeros(len(t) - 1)
    bottom = np.zeros(len(t) - 1)
    fastest = np.zeros(len(t) - 1)
    logged = np.diff(t)
    for x in q.T:
        slope = savgol_filter(x - x[0], width, CURVE_ORDER, deriv=1, mode="nearest") / pace
        v = 0.5 * (slope[1:] + slope[:-1])
        change = np.diff(x)
        moved = np.abs(change)
        if not moved.any():
            continue
        usual = np.median(logged)
        noise = min(
            float(np.median(np.abs(change - v * usual))),
            float(np.median(np.abs(change - v * logged))),
        )
        noise = max(1.4826 * noise / np.sqrt(2), moved[moved > 0].min() / np.sqrt(12))
        weight = 1 / (2 * noise**2)
        top += weight * change * v
        bottom += weight * v * v
        np.maximum(fastest, np.abs(v) / noise, out=fastest)
    known = bottom > 0
    # Where nothing moves the stamps are all there is, and worth little more than a step.
    passed = np.where(known, top / np.where(known, bottom, 1.0), logged)
    var = np.where(known, 1 / np.where(known, bottom, 1.0), np.inf) + (0.02 * step) ** 2
    slow = var > (0.5 * step) ** 2
    passed[slow], var[slow] = logged[slow], (0.5 * step) ** 2
    # The slope reaches over the ends of the stretch.
    var[:half] = var[len(var) - half :] = (0.5 * step) ** 2
    passed[:half], passed[len(passed) - half :] = logged[:half], logged[len(passed) - half :]
    return passed, var


def _mode(passed: NDArray[np.float64], step: float) -> float:
    """Most usual time between samples, s."""
    clock = float(np.median(passed))
    clock = clock if clock > 0.2 * step else step
    for width in (0.25, 0.1, 0.1):
        near = passed[np.abs(passed / clock - 1) < width]
        clock = float(np.median(near)) if len(near) else clock
    return clock


def _nice(clock: float, crystal: float) -> float:
    """The clock in whole 50 µs, as robots have it, if it agrees with that as crystals do."""
    whole = round(clock / 5e-5) * 5e-5
    return whole if whole > 0 and abs(clock / whole - 1) < crystal else clock


def _sampled(
    t: NDArray[np.float64],
    passed: NDArray[np.float64],
    var: NDArray[np.float64],
    clock: float,
) -> NDArray[np.float64]:
    """When each row was sampled, by stamps and motion together, from the first stamp: (T,), s."""
    sigma = 0.4 * clock
    weight = 1 / var
    band = np.zeros((2, len(t)))
    band[1] = 1 / sigma**2
    band[1, 1:] += weight
    band[1, :-1] += weight
    band[0, 1:] = -weight
    right = (t - t[0]) / sigma**2
    right[1:] += weight * passed
    right[:-1] -= weight * passed
    return np.asarray(solveh_banded(band, right))


def _ticks(sampled: NDArray[np.float64], clock: float) -> NDArray[np.int64]:
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
    for i in np.flatnonzero((np.diff(rows.t) <= 0) & (rows.run[1:] == rows.run[:-1])):
        rows.t[i + 1 :] += rows.t[i] - rows.t[i + 1] + usual_step(rows)
