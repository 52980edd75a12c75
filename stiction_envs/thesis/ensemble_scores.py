"""How Table 4.11 lies in the ensemble: intervals, coverage, signs, lag, and what would settle it.

All comparisons are of logarithms of sums, so that a change of +100 % and one of −50 % count alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from stiction_envs.experiments.gte.rows import thesis_final_dither, thesis_window_sums
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.thesis.ensemble import DITHER, FREE, NO_DITHER, NO_DITHER_LATER, Member
from stiction_envs.thesis.ensemble_prior import bare_arm, joint_speeds
from stiction_envs.thesis.gte import thesis_cases

Array = NDArray[np.float64]
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Ends of the 90 % and the 50 % interval, and the median between them."""
HALF = math.sin(math.pi / 4)
"""Speed over that of the dither at which `friction_left` is a half [-]."""


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
    scatter_of_mean: Array
    """(N,) the same of the mean change over the 24 cells."""

    @property
    def change(self) -> Array:
        """log(with dither / without), in two sessions."""
        return np.log(self.dither / self.no_dither)

    @property
    def by_dither(self) -> Array:
        """log(with dither / without), in one session."""
        return np.log(self.dither / self.no_dither_later)

    @property
    def by_session(self) -> Array:
        """log(later / earlier), without dither."""
        return np.log(self.no_dither_later / self.no_dither)


def stack(members: Sequence[Member]) -> Sums:
    """Return the sums of set-ups."""
    each = np.array([m.sums for m in members])  # (N, 4, 4, I, 6)
    count, repeats = len(members), each.shape[3]
    cells = np.moveaxis(each, 3, 2).reshape(count, each.shape[1], repeats, -1)
    mean, logs = cells.mean(axis=2), np.log(cells)
    scatter, of_mean = np.full((count, mean.shape[2]), np.nan), np.full(count, np.nan)
    if repeats > 1:
        both = logs[:, [DITHER, NO_DITHER_LATER]].var(axis=2, ddof=1)
        scatter = np.sqrt(both.mean(axis=1))
        # both runs of a pair differ as two iterations do: their common start is no help on a robot
        pair = logs.mean(axis=3)[:, [DITHER, NO_DITHER_LATER]].var(axis=2, ddof=1)
        of_mean = np.sqrt(pair.mean(axis=1))
    return Sums(
        no_dither=mean[:, NO_DITHER],
        dither=mean[:, DITHER],
        no_dither_later=mean[:, NO_DITHER_LATER],
        free=mean[:, FREE],
        scatter=scatter,
        scatter_of_mean=of_mean,
    )


def measured_sums() -> tuple[Array, Array]:
    """Return the measured sums (24,) without dither and with it."""
    cases = thesis_cases()
    printed = np.array([list((thesis_window_sums(c) or {}).values()) for c in cases], dtype=float)
    return printed[::2].ravel(), printed[1::2].ravel()


# ---- intervals -----------------------------------------------------------------------------------


def intervals(values: Array) -> Array:
    """Return the quantiles (5, 24) at `LEVELS` of values (N, 24)."""
    out: Array = np.quantile(values, LEVELS, axis=0)
    return out


def inside(ends: Array, values: Array) -> NDArray[np.bool_]:
    """Return whether values (24,) are in the 50 % and in the 90 % interval, (2, 24)."""
    return np.array([(ends[k] <= values) & (values <= ends[-1 - k]) for k in (1, 0)])


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """How many of the 24 cells lie in the intervals, and how many of a set-up's own would."""

    cells: int
    in_50: int
    in_90: int
    own_50: tuple[float, float, float]
    """5 %, median and 95 % over set-ups, each held against the intervals of the others."""
    own_90: tuple[float, float, float]
    as_few: int
    """Set-ups that have no more of their own cells in the 90 % intervals of the others."""
    set_ups: int


def coverage(values: Array, measured: Array) -> Coverage:
    """Return how measured values (24,) lie in the intervals of set-ups' values (N, 24).

    Cells hang together: a set-up that errs in one errs in others, so that 12 and 21.6 of 24 are
    only the means. What a set-up of the ensemble itself gets says how far from them is usual.
    """
    found = inside(intervals(values), measured).sum(axis=1)
    own = np.array(
        [
            inside(intervals(np.delete(values, k, axis=0)), values[k]).sum(axis=1)
            for k in range(len(values))
        ]
    )
    usual = np.quantile(own, (0.05, 0.5, 0.95), axis=0)
    return Coverage(
        cells=len(measured),
        in_50=int(found[0]),
        in_90=int(found[1]),
        own_50=tuple(usual[:, 0].tolist()),
        own_90=tuple(usual[:, 1].tolist()),
        as_few=int(np.sum(own[:, 1] <= found[1])),
        set_ups=len(values),
    )


# ---- set-up by set-up ----------------------------------------------------------------------------


def factor(simulated: Array, measured: Array) -> Array:
    """Return the typical factor (N,) between sums (N, 24) and (24,): e to the RMS logarithm."""
    out: Array = np.exp(np.sqrt((np.log(simulated / measured) ** 2).mean(axis=-1)))
    return out


def signs_right(change: Array, measured: Array) -> NDArray[np.int64]:
    """Return how many changes (N, 24) have the sign of the measured ones (24,)."""
    out: NDArray[np.int64] = (np.sign(change) == np.sign(measured)).sum(axis=-1)
    return out


def rank_correlation(change: Array, measured: Array) -> Array:
    """Return Spearman's rank correlation (N,) of changes (N, 24) with the measured ones (24,)."""
    return np.array([float(spearmanr(row, measured).statistic) for row in change])


def best_fitting(factors: Array, share: float) -> NDArray[np.int64]:
    """Return the set-ups with the smallest factors, a share of all and at least one."""
    count = max(1, round(share * len(factors)))
    out: NDArray[np.int64] = np.argsort(factors, kind="stable")[:count]
    return out


def lag(free: Array, whole: Array) -> Array:
    """Return the share of the error that is left without friction, median over cells (N,)."""
    out: Array = np.median(free / whole, axis=-1)
    return out


def friction_gone(change: Array, lags: Array) -> Array:
    """Return the share of dry friction (N,) that must be gone for the measured median change.

    Error is taken to rise with friction in a straight line, from lag alone to all of it; above 1
    no loss of friction is enough.

    Args:
        change: measured, logarithms (24,).
        lags: of set-ups (N,), see `lag`.
    """
    with np.errstate(divide="ignore"):
        out: Array = -np.expm1(np.median(change)) / np.maximum(1.0 - lags, 0.0)
    return out


# ---- what would settle it ------------------------------------------------------------------------


def pairs_needed(effect: Array, scatter: Array) -> Array:
    """Return how many pairs make an effect stand at two standard errors; inf for no effect.

    Args:
        effect: mean of the logarithm with over without dither.
        scatter: standard deviation of one run's logarithm; a pair's difference has √2 of it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.ceil(2.0 * (2.0 * scatter / effect) ** 2)


def repeats_needed(effect: float, drift: float) -> float:
    """Return how often two blocks have to be repeated on other days; inf for no effect.

    Args:
        effect: mean of the logarithm with over without dither.
        drift: standard deviation of its change from one session to another.
    """
    return float(np.ceil((2.0 * drift / effect) ** 2)) if effect else math.inf


def dither_speed(parameters: FrictionParameters) -> Array:
    """Return the speed (7,) at which the final dither shakes free rotors [rad/s].

    V = Aω/|K − Jω²|, K = 0 for a rigid joint (physics.md 4.2): peak of the oscillation of a rotor
    that neither sticks nor drags its link along.
    """
    rows = thesis_final_dither()
    amplitude = np.array([r.amplitude_nm for r in rows])
    omega = 2.0 * np.pi * np.array([r.frequency_hz for r in rows])
    stiffness = np.where(parameters.elastic, parameters.joint_stiffness, 0.0)
    out: Array = amplitude * omega / np.abs(stiffness - parameters.rotor_inertia * omega**2)
    return out


def friction_left(speed: Array, shaking: Array) -> Array:
    """Return the share of Coulomb friction left at a speed: (2/π) asin(v/V), 1 above V.

    Averaging over a sine of peak speed V (physics.md 4.1).
    """
    out: Array = 2.0 / np.pi * np.arcsin(np.minimum(speed / shaking, 1.0))
    return out


# ---- all of it -----------------------------------------------------------------------------------


def _spread(values: Array) -> dict[str, float]:
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95)).tolist()
    return {"low": low, "median": middle, "high": high}


def scores(
    members: Sequence[Member], measured: tuple[Array, Array], *, fitting: float
) -> dict[str, Any]:
    """Return all numbers of the page.

    Args:
        members: set-ups with their sums.
        measured: sums (24,) without dither and with it.
        fitting: share of set-ups called best fitting.
    """
    sums, before = stack(members), measured[0]
    change = np.log(measured[1] / before)
    factors = factor(sums.no_dither, before)
    best = best_fitting(factors, fitting)
    lags = lag(sums.free, sums.no_dither)
    ratio = np.exp(np.mean(np.log(sums.no_dither / before), axis=1))
    falls = int(np.sum(change < 0))
    kinds = {"both": sums.change, "dither": sums.by_dither, "session": sums.by_session}
    refused = sum(sum(m.refused.values()) for m in members)
    out: dict[str, Any] = {
        "set_ups": len(members),
        "iterations": members[0].sums.shape[2],
        "refused": refused,
        "refused_share": refused / (refused + len(members)),
        "near_limit": sum(m.flags["near_limit"] > 0 for m in members),
        "cells": len(before),
        "always_falls": falls,
        "sums": coverage(np.log(sums.no_dither), np.log(before)),
        "dither_sums": coverage(np.log(sums.dither), np.log(measured[1])),
        "changes": {k: coverage(v, change) for k, v in kinds.items()},
        "factor": {**_spread(factors), "best": float(factors.min())},
        "size": _spread(ratio),
        "measured_median_change": float(np.exp(np.median(change)) - 1.0),
        "lag": _spread(lags),
        "lag_best": float(np.median(lags[best])),
        "best": len(best),
        "lag_by_law": {
            law: float(np.median(lags[rows]))
            for law in sorted({m.set_up.damping_design for m in members})
            if (rows := [i for i, m in enumerate(members) if m.set_up.damping_design == law])
        },
        "kinds": {},
        "friction_gone": _spread(friction_gone(change, lags)),
        "settle": _settle(members, sums),
    }
    for name, values in kinds.items():
        middle = np.exp(np.median(values, axis=1)) - 1.0
        signs = signs_right(values, change)
        out["kinds"][name] = {
            "signs": _spread(signs.astype(float)),
            "signs_most": int(signs.max()),
            "above_falls": int(np.sum(signs > falls)),
            "rank": _spread(rank_correlation(values, change)),
            "median_change": _spread(middle),
            "reach": int(np.sum(middle <= np.exp(np.median(change)) - 1.0)),
        }
    return out


def _settle(members: Sequence[Member], sums: Sums) -> dict[str, Any]:
    """Return numbers of the measurements that would settle the table."""
    run = np.sqrt((sums.scatter**2).mean(axis=0))
    # of each set-up; what its iterations scatter is no effect
    effect = np.sqrt(np.maximum(sums.by_dither**2 - run**2, 0.0))
    drift = sums.by_session.std(axis=0, ddof=1)
    mean_effect = float(np.median(sums.by_dither.mean(axis=1)))
    mean_drift = float(sums.by_session.mean(axis=1).std(ddof=1))
    mean_run = float(np.sqrt((sums.scatter_of_mean**2).mean()))
    need = pairs_needed(effect, run)
    shaking = dither_speed(bare_arm().parameters)
    speeds = np.array([joint_speeds(m.set_up) for m in members])
    return {
        "mean_effect": mean_effect,
        "mean_drift": mean_drift,
        "mean_run": mean_run,
        "mean_pairs": float(pairs_needed(np.array(mean_effect), np.array(mean_run))),
        "mean_repeats": repeats_needed(mean_effect, mean_drift),
        "cell_effect": float(np.median(np.abs(sums.by_dither))),
        "cell_drift": float(np.median(drift)),
        "cell_run": float(np.median(run)),
        "cell_pairs": float(np.median(need)),
        "in_ten": float(np.mean(need <= 10)),
        "above_drift": float(np.mean(effect > 2.0 * drift)),
        "speed": np.median(speeds, axis=0).tolist(),
        "shaking": shaking.tolist(),
        "faster": float(np.mean(speeds > shaking)),
        "half": (HALF * shaking).tolist(),
    }
