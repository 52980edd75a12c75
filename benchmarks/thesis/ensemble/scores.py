"""How Table 4.11 lies in the ensemble: intervals, coverage, signs, lag, sessions.

All comparisons are of logarithms of sums, so that a change of +100 % and one of −50 % count alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from benchmarks.thesis.ensemble.runs import DITHER, FREE, NO_DITHER, NO_DITHER_LATER, Member

Array = NDArray[np.float64]
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Ends of the 90 % and the 50 % interval, and the median between them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sums:
    """Sums of N set-ups, means over iterations, (N, 24) in the order of the table."""

    no_dither: Array
    dither: Array
    """In another session than ``no_dither``, as the table may have been recorded."""
    no_dither_later: Array
    """In the session of ``dither``."""
    free: Array
    """Without dither and friction."""
    scatter: Array
    """(N, 24) standard deviation of the logarithm from one iteration to the next, without dither
    and with it, root of the mean of the squares; NaN for one iteration."""

    def changes(self) -> dict[str, Array]:
        """Return log(with dither / without) of all that differs, of dither and of the session."""
        return {
            "two sessions": np.log(self.dither / self.no_dither),
            "dither alone": np.log(self.dither / self.no_dither_later),
            "another session alone": np.log(self.no_dither_later / self.no_dither),
        }


def stack(members: Sequence[Member]) -> Sums:
    """Return the sums of set-ups."""
    each = np.moveaxis([m.sums for m in members], 3, 2)  # (N, 4 conditions, I, 4 places, 6 axes)
    cells = each.reshape(*each.shape[:3], -1)
    mean = cells.mean(axis=2)
    scatter = np.full(mean[:, 0].shape, np.nan)
    if cells.shape[2] > 1:
        both = np.log(cells)[:, [DITHER, NO_DITHER_LATER]].var(axis=2, ddof=1)
        scatter = np.sqrt(both.mean(axis=1))
    return Sums(
        no_dither=mean[:, NO_DITHER],
        dither=mean[:, DITHER],
        no_dither_later=mean[:, NO_DITHER_LATER],
        free=mean[:, FREE],
        scatter=scatter,
    )


# ---- intervals -----------------------------------------------------------------------------------


def intervals(values: Array) -> Array:
    """Return the quantiles (5, 24) at `LEVELS` of values (N, 24)."""
    return np.asarray(np.quantile(values, LEVELS, axis=0))


def inside(ends: Array, values: Array) -> NDArray[np.bool_]:
    """Return whether values (24,) are in the 50 % and in the 90 % interval, (2, 24)."""
    return np.array([(ends[k] <= values) & (values <= ends[-1 - k]) for k in (1, 0)])


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """How many of the 24 cells lie in the intervals, and how many of a set-up's own would."""

    in_50: int
    in_90: int
    own_90: tuple[float, float, float]
    """In 90 % intervals: 5 %, median and 95 % over set-ups, each held against the others."""
    as_few: int
    """Set-ups that have no more of their own cells in the 90 % intervals of the others."""


def coverage(values: Array, measured: Array) -> Coverage:
    """Return how measured values (24,) lie in the intervals of set-ups' values (N, 24).

    Cells hang together: a set-up that errs in one errs in others, so that 12 and 21.6 of 24 are
    only the means. What a set-up of the ensemble itself gets says how far from them is usual.
    """
    found = inside(intervals(values), measured).sum(axis=1)
    own = np.array(
        [
            inside(intervals(np.delete(values, k, axis=0)), values[k])[1].sum()
            for k in range(len(values))
        ]
    )
    low, middle, high = np.quantile(own, (0.05, 0.5, 0.95)).tolist()
    return Coverage(
        in_50=int(found[0]),
        in_90=int(found[1]),
        own_90=(low, middle, high),
        as_few=int(np.sum(own <= found[1])),
    )


# ---- set-up by set-up ----------------------------------------------------------------------------


def factor(simulated: Array, measured: Array) -> Array:
    """Return the typical factor (N,) between sums (N, 24) and (24,): e to the RMS logarithm."""
    return np.asarray(np.exp(np.sqrt((np.log(simulated / measured) ** 2).mean(axis=-1))))


def signs_right(change: Array, measured: Array) -> NDArray[np.int64]:
    """Return how many changes (N, 24) have the sign of the measured ones (24,)."""
    return np.asarray((np.sign(change) == np.sign(measured)).sum(axis=-1))


def rank_correlation(change: Array, measured: Array) -> Array:
    """Return Spearman's rank correlation (N,) of changes (N, 24) with the measured ones (24,)."""
    return np.array([float(spearmanr(row, measured).statistic) for row in change])


def lag(free: Array, whole: Array) -> Array:
    """Return the share of the error that is left without friction, median over cells (N,)."""
    return np.asarray(np.median(free / whole, axis=-1))


def friction_gone(change: Array, lags: Array) -> Array:
    """Return the share of dry friction (N,) that must be gone for the measured median change.

    Error is taken to rise with friction in a straight line, from lag alone to all of it; above 1
    no loss of friction is enough.

    Args:
        change: measured, logarithms (24,).
        lags: of set-ups (N,), see `lag`.
    """
    with np.errstate(divide="ignore"):
        return np.asarray(-np.expm1(np.median(change)) / np.maximum(1.0 - lags, 0.0))


def pairs_needed(effect: Array, scatter: Array) -> Array:
    """Return how many pairs of runs put an effect at two standard errors; inf for no effect.

    Args:
        effect: mean of the logarithm with over without dither.
        scatter: standard deviation of one run's logarithm; a pair's difference has √2 of it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.ceil(2.0 * (2.0 * scatter / effect) ** 2))
