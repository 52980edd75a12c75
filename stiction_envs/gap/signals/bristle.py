"""Dahl's bristle along the path of a joint: dry friction that lags its reversals."""

import numpy as np

from stiction_envs.arrays import Array, Index
from stiction_envs.compiled import compiled
from stiction_envs.measured.motion_thresholds import START_SAMPLES, START_SPAN


def bristles(path: Array, runs: list[slice], distance: Array) -> Array:
    """Return (F, n, k) bristle torque over its steady level, for k presliding distances [-].

    Dahl's model ζ' = (q̇ − |q̇| ζ)/d (P. Dahl, "A solid friction model", 1968), exact: between two
    turns ζ goes to the sign of the motion by e^(−x/d) over the path x. LuGre without Stribeck
    effect and bristle damping. The bristle's state before a segment is unknown: a joint that moves
    at its start has already slid far; one that rests may hold any torque, zero on average.

    Args:
        path: (F, n) [rad].
        runs: rows of each segment.
        distance: (n, k) d [rad].
    """
    out = np.zeros((*path.shape, distance.shape[-1]))
    for run in runs:
        if run.stop - run.start < 2:
            continue
        for j in range(path.shape[1]):
            x = path[run, j]
            begun = abs(x[min(START_SAMPLES, len(x) - 1)] - x[0]) > START_SPAN
            side, turn = _turns(x)
            if turn[-1] < 0:
                continue  # the joint rests throughout
            # numpy's exponential of a whole array is several times as fast as a compiled loop's
            left = np.exp(-np.abs(x - x[np.maximum(turn, 0)])[:, None] / distance[j])
            _follow(side, turn, left, float(begun), out[run, j])
    return out


@compiled
def _turns(x: Array) -> tuple[Array, Index]:
    """Return (K,) sign of the motion by which each row was reached, and the row of the last turn.

    Before the first motion they are the sign of that motion and −1.
    """
    side, turn = np.zeros(len(x)), np.full(len(x), -1)
    last, at = 0.0, -1
    for i in range(1, len(x)):
        now = np.sign(x[i] - x[i - 1])
        if now != 0 and now != last:
            if at < 0:
                side[:i] = now
            last, at = now, i - 1
        side[i], turn[i] = last, at
    return side, turn


@compiled
def _follow(side: Array, turn: Index, left: Array, begun: float, out: Array) -> None:
    """Write bristles that leave a turn by ``left`` (K, k) into ``out`` (K, k)."""
    zeta = np.full(left.shape[1], side[0] * begun)
    at = -1
    for i in range(len(side)):
        if turn[i] != at:
            at = turn[i]
            zeta[:] = out[at]
        for k in range(len(zeta)):
            out[i, k] = zeta[k] if at < 0 else side[i] + (zeta[k] - side[i]) * left[i, k]


def grown(
    path: Array, runs: list[slice], distance: float, zeta: Array, growth: Array, ratio: float = 0.0
) -> Array:
    """Return (T,) what a bristle adds per unit of a level that grows by ``growth``.

    A bristle σ0 z of level g + εw, z' = q̇ − σ0 |q̇| z/(g + εw), is to first order in ε
    gζ + εη with d = g/σ0 and η' = |q̇| (wζ − η)/d: η tends to wζ, but turns later than ζ, since
    the stiffness is unchanged. For larger ε, with r = ε/g, it is (y − ζ)/r of
    y' = (q̇ − |q̇| y/(1 + rw))/d. Both are exact for w that is constant over a sample.

    Args:
        path: (T,) [rad].
        runs: rows of each segment.
        distance: d [rad].
        zeta: (T,) of `bristles` with that distance [-].
        growth: (T,) w, any unit; at turns the value of the new direction.
        ratio: r, per unit of w; 0 for the first order.
    """
    out = np.empty(len(path))
    for run in runs:
        if ratio == 0.0:
            out[run] = _first_order(path[run], distance, zeta[run], growth[run])
        else:
            y = _taller(path[run], distance, float(zeta[run.start]), 1.0 + ratio * growth[run])
            out[run] = (y - zeta[run]) / ratio
    return out


@compiled
def _first_order(path: Array, distance: float, zeta: Array, growth: Array) -> Array:
    """Return (K,) η of `grown` along one segment."""
    out = growth * zeta
    for k in range(len(path) - 1):
        if abs(zeta[k]) >= SETTLED and abs(zeta[k + 1]) >= SETTLED:
            continue  # after some distances ζ is steady, and so is η
        step = path[k + 1] - path[k]
        side, w, decay = np.sign(step), growth[k + 1], abs(step) / distance
        if side == 0:
            out[k + 1] = out[k]
        else:
            left = out[k] - w * side + w * (zeta[k] - side) * decay
            out[k + 1] = w * side + left * np.exp(-decay)
    return out


@compiled
def _taller(path: Array, distance: float, zeta: float, level: Array) -> Array:
    """Return (K,) a bristle that tends to the sign of the motion times a level (K,) [-]."""
    out = np.empty(len(path))
    out[0] = zeta * level[0]
    for k in range(len(path) - 1):
        step = path[k + 1] - path[k]
        top = max(level[k + 1], LOWEST)
        end = np.sign(step) * top
        out[k + 1] = end + (out[k] - end) * np.exp(-abs(step) / (distance * top))
    return out


LOWEST = 1e-3
"""Least level of a bristle over that of plain dry friction [-]; assumed."""
SETTLED = 1.0 - 1e-4
"""ζ above which a bristle has reached its level [-]; assumed."""
