"""How well a log knows the parameters of one joint: intervals, correlations, and the lag.

Damping, armature and delay all make a joint late. A slow motion shows their sum, how late the joint
is, but not which of them it is: there a fit keeps one of them by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from stiction_envs.gap.judge.judgement import Estimate
from stiction_envs.gap.servo.fit import Fit, derivatives
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.parameters import INDEX, PARAMETERS, STEP

Array = NDArray[np.float64]
LAG = ("damping", "armature", "delay")
"""Causes, each with a parameter of its name, whose sum, the lag, a log shows better than each."""
SERVO_LAG = "servo_lag"
"""The cause that is named instead of them where they cannot be told apart."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """Covariance of parameters."""

    names: tuple[str, ...]
    """Names of the F parameters."""
    covariance: Array
    """(F, F) in SI units."""
    correlation: Array
    """(F, F), of what the motion alone says, whatever the noise."""
    quantile: float
    """Half a 95 % interval over the standard deviation [-]."""

    def half(self, gradient: Array) -> float:
        """Return half the 95 % interval of a sum with weights (F,) of the parameters."""
        variance = float(gradient @ self.covariance @ gradient)
        return self.quantile * float(np.sqrt(max(variance, 0.0)))

    def half_of(self, name: str) -> float:
        """Return half the 95 % interval of a parameter."""
        return self.half((np.array(self.names) == name).astype(np.float64))


def spread_of(
    motion: JointMotion,
    fit: Fit,
    names: Sequence[str],
    counts: NDArray[np.bool_],
    block: NDArray[np.int64],
) -> Spread:
    """Return the spread of some parameters around a fit.

    The scores' scatter between blocks of time stands for noise of any colour.

    Args:
        motion: of the joint.
        fit: of its parameters.
        names: of the parameters, whether fitted or not.
        counts: (T,) rows that count.
        block: (T,) number of each row's block of time.
    """
    at = np.array([INDEX[name] for name in names], dtype=np.int64)
    if len(at) == 0:
        none = np.zeros((0, 0))
        return Spread(names=(), covariance=none, correlation=none, quantile=0.0)
    slopes = derivatives(motion, fit.parameters, at, fit.angle) * counts
    hessian = slopes @ slopes.T + 1e-15 * np.eye(len(at))
    scores = np.stack([np.bincount(block, weights=row * fit.error) for row in slopes])
    inverse = np.linalg.pinv(hessian)
    covariance = inverse @ (scores @ scores.T) @ inverse
    scale = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    return Spread(
        names=tuple(names),
        covariance=covariance * np.outer(STEP[at], STEP[at]),
        correlation=inverse / np.outer(scale, scale),
        quantile=float(student.ppf(0.975, max(1, scores.shape[1] - len(at)))),
    )


EXTRA_STICTION = "extra_stiction"
"""Name of the friction at rest above its level in motion, F_s s, among the estimates."""


def estimates_of(fit: Fit, spread: Spread) -> dict[str, Estimate]:
    """Return each fitted parameter with its 95 % interval, and `EXTRA_STICTION` where it falls."""
    out = {}
    for name in spread.names:
        p, value, half = PARAMETERS[name], fit[name], spread.half_of(name)
        out[name] = Estimate(
            value=value,
            ci95=(max(value - half, p.low), min(value + half, p.high)),
            on_bound=value <= p.low + 1e-9 or value >= p.high - 1e-9,
        )
    if "drop" in out:
        value = fit["stiction"] * fit["drop"]
        slope = {"stiction": fit["drop"], "drop": fit["stiction"]}
        half = spread.half(np.array([slope.get(name, 0.0) for name in spread.names]))
        out[EXTRA_STICTION] = Estimate(
            value=value,
            ci95=(max(value - half, 0.0), value + half),
            on_bound=out["drop"].on_bound,
        )
    return out


def lag_of(fit: Fit, spread: Spread, nominal: Array, needed: Sequence[str]) -> Estimate | None:
    """Return a joint's lag [s] where a log knows it and none of its parts; else None.

    The lag is how late the joint follows a steady motion: delay + damping/stiffness. A part is
    known where no other does in its place, and where its interval, with all three parts free, does
    not hold its nominal value.

    Args:
        fit: of the joint.
        spread: with all parts that could be fitted among its parameters.
        nominal: (P,) parameters of the simulation that is judged.
        needed: parts in whose place no other does.
    """
    known = [c for c in needed if abs(fit[c] - nominal[INDEX[c]]) > spread.half_of(c)]
    if known or not {"damping", "delay"} <= set(spread.names):
        return None
    stiffness = fit["stiffness"]
    slope = {"delay": 1.0, "damping": 1.0 / stiffness, "stiffness": -fit["damping"] / stiffness**2}
    half = spread.half(np.array([slope.get(name, 0.0) for name in spread.names]))
    lag = fit["delay"] + fit["damping"] / stiffness
    of_nominal = nominal[INDEX["delay"]] + nominal[INDEX["damping"]] / nominal[INDEX["stiffness"]]
    if abs(lag - of_nominal) <= half:
        return None
    return Estimate(value=lag, ci95=(lag - half, lag + half), on_bound=False)
