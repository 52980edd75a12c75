"""The robot's clock behind the logger's.

A logger stamps a sample when it receives it. The motion shows when the sample was taken: at speed v
an angle grows by v·Δt, whatever the stamp is. So from row to row

    kᵢ = Σⱼ wⱼ Δqᵢⱼ vᵢⱼ / Σⱼ wⱼ vᵢⱼ²

samples passed by the motion. Here v is the usual change of a joint around the row, a median that a
few jumps do not bend, and wⱼ = 1/(2 sⱼ²) with the noise sⱼ of the angle. k is rounded to whole
samples where all joints agree on one number; where nothing moves the stamps say it. If k is whole
nearly everywhere, the angles follow a regular clock, whose step is the slope of the stamps over the
samples counted. No published source: derived here.

Stamps that are whole steps may be a mere count of rows: samples that were lost, or came late, leave
no mark in the stamps, but the angles jump. The samples that the motion shows are then added.
"""

from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.measured.logs.corrections import Correction, RawLog

REGULAR = 1e-3
"""Stamps are a clock already if their steps are whole ones but for this share [-]; assumed."""
EXACT = 0.02  # stamps that are this near to the robot's clock stay [steps]; assumed
COARSE = 0.1
"""A clock is coarse if more than this share of rows has the time of the row before [-]; assumed."""
CRYSTAL = 3e-4  # two clocks with quartz crystals agree to this share [-]; assumed
SEEN_DRIFT = 1e-5
"""Smallest drift of the logger's clock against the robot's that is reported [-]; assumed."""
LEAST_ROWS = 200  # fewer rows whose motion shows the samples that passed show no clock; assumed
GAP_STEPS = 5.0  # a step of more than this many usual ones, and of `GAP_SECONDS`, is a gap; assumed
GAP_SECONDS = 0.025  # see `GAP_STEPS` [s]; assumed
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
LEAST_NOISE = 1e-9  # least noise of an angle [rad]; assumed: no encoder is better
SLOWEST = 0.02
"""Rows further apart do not show by their motion how many samples passed [s]; assumed."""
REGULAR_SHARE = 0.95
"""Least share of steps of whole samples behind stamps that come in bursts [-]; assumed."""
ROUNDS = 2
"""Rounds of counting: samples that were lost make the usual change too large at first [-]."""
LATE_ROWS = (5, 10, 20, 40)  # rows after one that came late, of which one is in time again; assumed
TURNED = 0.5
"""Largest change of the speeds about a row over the speeds, where a row may tell its time [-];
assumed: more is an arm that stops."""


def usual_step(rows: RawLog) -> float:
    """Return the median time between rows of different times [s]; NaN for a single row."""
    step = np.diff(rows.t)[rows.run[1:] == rows.run[:-1]]
    step = step[step > 0]
    return float(np.median(step)) if len(step) else float("nan")


def find_gaps(t: Array, step: float) -> Index:
    """Return the first row after each gap of times ``t`` (T,) [s] with usual step ``step`` [s]."""
    return np.flatnonzero(np.diff(t) > _gap(step)) + 1


def _gap(step: float) -> float:
    """Return the longest time between rows that is no gap [s]."""
    return max(GAP_STEPS * step, GAP_SECONDS)


def correct_clock(rows: RawLog, slowest: float = SLOWEST) -> list[Correction]:
    """Make the time of ``rows`` strictly rising and, where the motion shows it, regular; in place.

    The motion is asked where the usual step is at most ``slowest`` [s].
    """
    corrections: list[Correction] = []
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
    step = usual_step(rows)
    if 0 < step <= slowest:
        parts = _recordings(rows)
        steps = np.concatenate([np.empty(0), *(np.diff(rows.t[p]) / step for p in parts)])
        steps = steps[steps <= _gap(step) / step]
        whole = np.abs(steps - np.round(steps)).max(initial=0.0) < REGULAR
        corrections += _add_lost(rows, parts, step) if whole else _count(rows, parts, step)
    return corrections


def _not_rising(rows: RawLog) -> Bools:
    """Return (T-1,) whether the next row of a recording has no later time."""
    return (np.diff(rows.t) <= 0) & (rows.run[1:] == rows.run[:-1])


def _spread_equal(rows: RawLog) -> Correction:
    """Space rows with equal stamps evenly up to the next stamp: the clock is too coarse."""
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


def _add_lost(rows: RawLog, parts: list[slice], step: float) -> list[Correction]:
    """Give rows whose stamps are whole steps the samples that passed by the motion; in place."""
    more = np.zeros(len(rows.t))
    for p in parts:
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


def _count(rows: RawLog, parts: list[slice], step: float) -> list[Correction]:
    """Count the samples that passed from row to row, if the angles are regular; in place."""
    whole = seen = 0
    counted, groups = np.zeros(len(rows.t)), np.zeros(len(rows.t), np.int64)
    for p in parts:
        t = rows.t[p]
        counts = np.ones(len(t) - 1)
        for _ in range(ROUNDS):
            passed, evident, odd = _samples_passed(rows.data["q"][p], counts, step)
            counts = np.where(odd, np.round(passed), counts)
        whole += int((np.abs(passed - counts) < WHOLE[0] + WHOLE[1] * counts)[evident].sum())
        seen += int(evident.sum())
        # where nothing moves: what was late is made up for after some rows, what was lost is not
        row = np.arange(len(t) - 1)
        ahead = [np.minimum(row + 1 + x, len(t) - 1) for x in LATE_ROWS]
        lost = np.min([np.round((t[i] - t[:-1]) / step) - (i - row) for i in ahead], axis=0)
        counts += np.where(evident | (lost < 2), 0.0, lost)
        counted[p] = np.r_[0.0, np.cumsum(counts)]
        groups[p] = groups.max() + 1 + np.r_[0, np.cumsum(~evident)]
    if seen < LEAST_ROWS or whole < REGULAR_SHARE * seen:
        return []
    pace = _pace(rows.t, counted, groups)
    # of whole 50 µs where these agree with the pace as crystals do
    clock = round(pace / 5e-5) * 5e-5
    if clock <= 0 or abs(pace / clock - 1) >= CRYSTAL:
        clock = pace
    new, late = rows.t.copy(), np.zeros(len(rows.t))
    for p in parts:
        new[p] = counted[p] * clock + np.median(rows.t[p] - counted[p] * clock)
        off = rows.t[p] - counted[p] * pace
        late[p] = np.abs(off - np.median(off))
    stray = float(np.percentile(late, 99))
    if stray < EXACT * clock:
        return []
    rows.t = new
    for i in np.flatnonzero(_not_rising(rows)):  # recordings that were moved follow one another
        rows.t[i + 1 :] += rows.t[i] - rows.t[i + 1] + usual_step(rows)
    gained = pace / clock - 1
    drift = f", and gain {1e6 * gained:.0f} millionths on it" if abs(gained) > SEEN_DRIFT else ""
    text = (
        f"robot clock rebuilt: the angles follow a regular {1e3 * clock:.6g} ms clock in "
        f"{whole / seen:.1%} of the steps; 99 % of the logged stamps are within "
        f"{1e3 * stray:.2g} ms of it{drift}"
    )
    return [Correction(kind="clock", rows=len(rows.t), text=text)]


def _recordings(rows: RawLog) -> list[slice]:
    """Return the rows of each recording that is long enough to show its usual changes."""
    cut = np.flatnonzero(rows.run[1:] != rows.run[:-1]) + 1
    bounds = pairwise(np.r_[0, cut, len(rows.t)].astype(int))
    return [slice(a, b) for a, b in bounds if b - a > 2 * AROUND]


def _samples_passed(q: Array, logged: Array, step: float) -> tuple[Array, Bools, Bools]:
    """Return how many samples passed from row to row by the motion of (T, n), (T-1,).

    Also where two joints or more show it (one alone may have slipped), and where the stamps, by
    which ``logged`` (T-1,) samples passed, say otherwise; ``step`` [s].
    """
    change = np.diff(q, axis=0)
    # speeds before and after, so that a row in which much time passed is no part of either
    half = 2 * int(np.clip(AROUND_SECONDS / step, 5, AROUND) // 4) + 1
    near = median_filter(change / np.maximum(logged, 1.0)[:, None], size=(half, 1), mode="nearest")
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


def _pace(t: Array, ticks: Array, groups: Index) -> float:
    """Return the time per tick [s], fitted to groups of rows, each from its own start."""
    count = np.maximum(np.bincount(groups), 1)
    x, y = (v - (np.bincount(groups, v) / count)[groups] for v in (ticks, t))
    return float(x @ y / (x @ x))
