"""Rows of a log that are no samples: repeats, frozen stretches, half-new rows, missing values.

A logger that runs next to the robot writes what it received last. A row that repeats the one before
it is dropped. A row where only some channels are new is merged with its neighbour or dropped. A
missing value is interpolated if its neighbours are there. A robot at rest repeats itself too: a
repeat counts only where the changes around it show that it cannot be chance.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.errors import StictionError

CHANCE_ROWS = 1e4  # a repeat that happens by chance once in this many rows is none; assumed
NEAR_CHANGES = 4
"""Changes on each side of a row that show how often it would repeat by chance; assumed."""
MOST_REPEATS = 20  # more repeats in a row are a pause or a frozen log; assumed
JUMP = 5.0
"""After a frozen stretch the arm is this many steps further, and this much faster [-]; assumed."""
MOST_MISSING_RUN = 5  # most missing values in a row that are interpolated; assumed
MOST_MISSING = 0.01
"""Largest share of missing values of a column that are interpolated [-]; assumed."""
LEAST_CHANGES = 20
"""Fewest changes of a column that show for how many rows it holds a value [-]; assumed."""
LEAST_STEPS = 3.0
"""A held value changes by more than this many of its smallest steps, usually [-]; assumed: a
smaller change repeats itself by chance."""
FEW_STALE = 0.2
"""Up to this share of rows with an old position are dropped, more are interpolated [-]; assumed."""
TURN = 2 * np.pi
OFF = 0.5  # a jump is a turn to this much, which the joint moves meanwhile [rad]; assumed
CORE = ("q", "dq", "tau")
"""Channels that a joint log measures with every sample; those but dq are needed."""
SERVO_CORE = ("q_cmd", "q", "dq")
"""Channels that a servo log measures with every sample."""


@dataclass(frozen=True, kw_only=True)
class Correction:
    """Something that was corrected in a log."""

    kind: str
    """``missing``, ``repeat``, ``frozen``, ``stale``, ``held``, ``stamp``, ``clock``, ``epoch``,
    ``run``, ``wrap`` or ``gap``."""
    rows: int
    text: str
    """One sentence for the report."""
    lag: tuple[float, float] | None = None
    """Delay and time constant of a lag of the torques that was undone [s]."""


@dataclass(kw_only=True)
class RawLog:
    """A log as it is in the file; corrections change it in place."""

    source: str
    """Path as given."""
    t: Array
    """Logged time, (T,), s; row numbers where the log has none."""
    data: dict[str, Array]
    """The required channels (`columns.CHANNELS`) and optional ones, (T, n) each."""
    run: Index
    """Number of the recording of each row, (T,), from 0."""
    place: Callable[[int], str]
    """Where a row is, such as ``a.csv, line 17``."""
    ignored: tuple[str, ...] = ()
    side: str | None = None
    """Side of the gear on which ``tau`` was measured, where the file says it: motor or link."""
    origin: float = 0.0
    """Time of the clock at ``t`` = 0, s, where its reader took that off."""
    notes: list[Correction] = field(default_factory=list)
    """Notes for a person on how it was read."""
    warnings: list[str] = field(default_factory=list)
    measured: tuple[str, ...] = CORE
    """Channels that are measured with every sample, where the log has them."""
    held: int = 1
    """Most rows for which a column usually holds one value."""

    def note(self, text: str, rows: int = 0) -> None:
        """Add a note on how it was read, which may concern some rows."""
        self.notes.append(Correction(kind="source", rows=rows, text=text))

    def keep(self, mask: Bools) -> None:
        """Drop the rows where ``mask`` is False."""
        self.t, self.run = self.t[mask], self.run[mask]
        self.data = {name: array[mask] for name, array in self.data.items()}

    def core(self) -> list[str]:
        """Return the names of the channels that are measured with every sample."""
        return [name for name in self.measured if name in self.data]


def fill_missing(rows: RawLog) -> tuple[list[Correction], list[str]]:
    """Interpolate isolated missing values (NaN), in place; return corrections and warnings.

    Rows without any measured value (`CORE`, `SERVO_CORE`) are dropped, as are incomplete rows at
    the ends. Slow extra channels are interpolated over any length, or left out with fewer than two
    values; dq is left out where too much is missing.

    Raises:
        StictionError: too many values of a channel that is needed are missing.
    """
    core = rows.core()
    warnings: list[str] = []
    corrections: list[Correction] = []
    index = np.arange(len(rows.t))
    empty = np.ones(len(index), bool)
    for name in core:
        empty &= np.isnan(rows.data[name]).all(axis=1)
    if empty.all():
        raise StictionError(f"{rows.place(0)}: no row has values: expected numbers")
    corrections += _corrected("missing", empty, "{} without any value dropped")
    alive = index[~empty]
    holes = np.zeros(len(index), bool)
    for name in [*core, *(n for n in rows.data if n not in core)]:
        array = rows.data[name]
        for j in range(array.shape[1]):
            missing = np.isnan(array[alive, j])
            if not missing.any():
                continue
            column = f"{name}{j + 1}"
            longest = longest_run(missing)
            many = longest > MOST_MISSING_RUN or missing.mean() > MOST_MISSING
            if many and name in core and name != "dq":
                raise StictionError(
                    f"{rows.place(int(alive[np.argmax(missing)]))}: {column} has no value, in "
                    f"{missing.sum()} of {len(alive)} rows, {longest} in a row: expected at "
                    f"most {MOST_MISSING_RUN} in a row and {MOST_MISSING:.0%} in all"
                )
            if missing.all() or (many and name == "dq"):
                warnings.append(
                    f"{column} has no value in {missing.sum()} of {len(alive)} rows: "
                    f"{name} is not used"
                )
                del rows.data[name]
                break
            if name in core:
                holes[alive[missing]] = True
            good = alive[~missing]
            array[alive[missing], j] = np.interp(
                rows.t[alive[missing]], rows.t[good], array[good, j]
            )
    # Beyond its ends a channel cannot be interpolated.
    whole = np.flatnonzero(~holes & ~empty)
    inside = (index >= whole[0]) & (index <= whole[-1])
    edge = holes & ~inside
    corrections += _corrected("missing", edge, "{} with missing values at the ends dropped")
    corrections += _corrected(
        "missing", holes & inside, "{} with single missing values interpolated"
    )
    if edge.any() or empty.any():
        rows.keep(~edge & ~empty)
    return corrections, warnings


def drop_repeats(rows: RawLog) -> list[Correction]:
    """Drop rows where only the clock moved although the arm did, in place."""
    fresh, active = _freshness(rows)
    same = ~np.logical_or.reduce(list(fresh.values()))
    if not same.any():
        return []
    drop, frozen = np.zeros(len(same), bool), np.zeros(len(same), bool)
    alive = same & np.logical_or.reduce(list(active.values()))
    step = np.zeros(len(same))
    for x in rows.data["q"].T:
        np.maximum(step[1:], _changes(x, rows.run), out=step[1:])
    for start, end in runs(same):
        if end - start <= MOST_REPEATS:
            drop[start:end] = alive[start:end].any()
        elif end < len(same):
            after = step[end + 1 : end + 4].max(initial=0.0)
            frozen[start:end] = step[end] >= JUMP and step[end] > JUMP * after
    first = rows.t[np.argmax(frozen)]
    rows.keep(~(drop | frozen))
    return [
        *_corrected("repeat", drop, "{} repeated the row before, only the clock moved: dropped"),
        *_corrected(
            "frozen",
            frozen,
            f"{{}} dropped: the log stopped and then jumped, first at t = {first:.3f} s",
        ),
    ]


def correct_stale(rows: RawLog) -> list[Correction]:
    """Correct, in place, rows whose q, dq or tau is still that of the row before.

    Two neighbours that hold one sample between them become one row. What is left: a row with an
    old q is dropped, or, where these are many, its q interpolated; an old dq or tau is
    interpolated.
    """
    fresh, active = _freshness(rows)
    same = {name: _short(~new, MOST_REPEATS) for name, new in fresh.items()}
    stale = {name: same[name] & active[name] for name in fresh}
    any_stale = np.logical_or.reduce(list(stale.values()))
    if not any_stale.any():
        return []
    # Complementary: each channel is new in exactly one of the two rows.
    pair = np.r_[rows.run[1:] == rows.run[:-1], False]
    pair &= any_stale | np.r_[any_stale[1:], False]
    for old in same.values():
        pair &= old ^ np.r_[old[1:], False]
    second = np.zeros(len(pair), bool)
    for i in np.flatnonzero(pair):
        if not second[i]:
            second[i + 1] = True
    for name in fresh:
        later = np.flatnonzero(second & fresh[name])
        rows.data[name][later - 1] = rows.data[name][later]
        stale[name][later - 1] = False
    # The row with the new q gives the sample its time.
    late_q = np.flatnonzero(second & fresh["q"])
    rows.t[late_q - 1] = rows.t[late_q]
    corrections = _corrected("stale", second, "{} held the other half of a sample: put together")
    old_q, drop = stale.pop("q") & ~second, second.copy()
    few = old_q.mean() <= FEW_STALE
    if few:
        drop |= old_q
    else:
        _refill(rows, "q", old_q, ~drop)
    text = "{} had new torques but an old q: " + ("dropped" if few else "q interpolated")
    corrections += _corrected("stale", old_q, text)
    for name, of in stale.items():
        old = of & ~drop
        _refill(rows, name, old, ~drop)
        corrections += _corrected("stale", old, f"{{}} had a new q but an old {name}: interpolated")
    rows.keep(~drop)
    return corrections


def spread_held(rows: RawLog) -> list[Correction]:
    """Correct, in place, columns that hold each value for two rows or more (polled in turn).

    The rows where a value is new stay; a spline through them gives the others.
    """
    held: dict[str, list[int]] = {}
    for name in rows.core():
        for j, x in enumerate(rows.data[name].T):
            change = _changes(x, rows.run)
            new = np.r_[True, change > 0]
            new[1:] |= rows.run[1:] != rows.run[:-1]
            at = np.flatnonzero(new)
            if len(at) < LEAST_CHANGES or np.median(change[change > 0]) < LEAST_STEPS:
                continue
            usual = int(np.median(np.diff(at)))
            if usual < 2:
                continue
            # what rests for longer was read again, and had not changed
            since = np.arange(len(new)) - at[np.cumsum(new) - 1]
            new |= since > 2 * usual
            new[-1] = True
            rows.data[name][:, j] = _through(rows.t, x, new)
            held.setdefault(name, []).append(usual)
    corrections = []
    for name, usual_rows in held.items():
        rows.held = max(rows.held, *usual_rows)
        many = (
            f"{name} of {len(usual_rows)} joints" if len(usual_rows) > 1 else f"{name} of a joint"
        )
        text = (
            f"each value of {many} stands for {max(usual_rows)} rows: only new ones are used, "
            "with a spline between them"
        )
        corrections.append(Correction(kind="held", rows=len(rows.t), text=text))
    return corrections


def longest_run(flags: Bools) -> int:
    """Return the length of the longest run of True."""
    return max((end - start for start, end in runs(flags)), default=0)


def runs(flags: Bools) -> list[tuple[int, int]]:
    """Return the first row of each run of True, and the row after it."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(np.int8), 0]))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _corrected(kind: str, mask: Bools, text: str) -> list[Correction]:
    """Return the correction of some rows, their number in the text; none for no rows."""
    count = int(mask.sum())
    shown = text.format(f"{count} row{'s' if count > 1 else ''}")
    return [Correction(kind=kind, rows=count, text=shown)] if count else []


def _refill(rows: RawLog, name: str, old: Bools, kept: Bools) -> None:
    array = rows.data[name]
    good = kept & ~old
    for j in range(array.shape[1]):
        if name == "q":
            array[:, j] = _through(rows.t, array[:, j], good)
        else:  # noise would swing between its values
            array[old, j] = np.interp(rows.t[old], rows.t[good], array[good, j])


def _through(t: Array, x: Array, good: Bools) -> Array:
    """Return good values of ``x`` (T,); a cubic through these replaces the others."""
    rising = good & np.r_[True, np.diff(t) > 0]
    out, old = x.copy(), ~good
    out[old] = CubicSpline(t[rising], x[rising])(t[old])
    first, last = np.flatnonzero(good)[[0, -1]]
    out[:first], out[last + 1 :] = x[first], x[last]
    return out


def _short(flags: Bools, most: int) -> Bools:
    """Return the flags without runs longer than ``most``: there the arm rests."""
    short = flags.copy()
    for start, end in runs(flags):
        if end - start > most:
            short[start:end] = False
    return short


def _freshness(rows: RawLog) -> tuple[dict[str, Bools], dict[str, Bools]]:
    """Return, per channel, rows that differ from the one before, and rows that should differ.

    If a joint changes by c of its smallest steps from row to row, it repeats itself by chance
    about once in 1 + 2c rows; the joints together as often as the product. The changes on both
    sides of a row count, whichever are smaller, so that an arm that has stopped may repeat itself.
    Channels are judged one by one: when an arm stops, they stop together.
    """
    fresh, active = {}, {}
    begins = np.r_[True, rows.run[1:] != rows.run[:-1]]
    for name in rows.core():
        rarity = np.zeros(len(rows.t))
        for x in rows.data[name].T:
            rarity[1:] += np.log1p(2 * _changes(x, rows.run))
        new = rarity > 0
        fresh[name] = new | begins
        at = np.flatnonzero(new)
        total = np.r_[0.0, np.cumsum(rarity[at])]
        count = np.arange(len(at) + 1)
        behind, ahead = (
            np.maximum(count - NEAR_CHANGES, 0),
            np.minimum(count + NEAR_CHANGES, len(at)),
        )
        before = (total - total[behind]) / np.maximum(count - behind, 1)
        after = (total[ahead] - total) / np.maximum(ahead - count, 1)
        before[0], after[-1] = after[0], before[-1]
        active[name] = np.minimum(before, after)[np.cumsum(new)] >= np.log(CHANCE_ROWS)
    return fresh, active


def _changes(x: Array, run: Index) -> Array:
    """Return (T-1,) absolute changes of ``x`` (T,) in its smallest steps; 0 between runs."""
    change = np.abs(np.diff(x))
    change[run[1:] != run[:-1]] = 0.0
    moved = change[change > 0]
    # Rounded decimals differ by rounding of floats too, far below any sensor's step.
    return change / max(np.percentile(moved, 1), 1e-7 * np.ptp(x)) if len(moved) else change


def unwrap(rows: RawLog) -> list[Correction]:
    """Add whole turns to angles where they jump by one, and to commands a turn away, in place."""
    found: dict[str, int] = {}
    for name in (x for x in ("q", "q_cmd") if x in rows.data):
        for j, x in enumerate(rows.data[name].T):
            if jumps := _unwrap(x):
                found[f"{name}{j + 1}"] = jumps
    if "q_cmd" in rows.data:
        for j, (x, q) in enumerate(zip(rows.data["q_cmd"].T, rows.data["q"].T, strict=True)):
            both = ~np.isnan(x - q)
            apart = float(np.median((x - q)[both])) if both.any() else 0.0
            if (turns := round(apart / TURN)) and abs(apart - turns * TURN) < OFF:
                x -= turns * TURN
                found.setdefault(f"q_cmd{j + 1}", 1)
    text = f"{', '.join(found)}: angles within one turn, which jump at its ends: unwrapped"
    return [Correction(kind="wrap", rows=sum(found.values()), text=text)] if found else []


def _unwrap(x: Array) -> int:
    """Add whole turns to angles (T,) within one turn, in place; return how often they jump."""
    known = np.flatnonzero(~np.isnan(x))
    if not len(known) or np.ptp(x[known]) > TURN + 1e-3:
        return 0
    jump = np.diff(x[known])
    turns = -np.sign(jump) * (np.abs(jump) > TURN - OFF)
    x[known[1:]] += TURN * np.cumsum(turns)
    return int(np.count_nonzero(turns))
