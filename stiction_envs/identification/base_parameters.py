"""Least squares of torques on base parameters of links and friction, with their errors.

Rows are samples of joints, divided by each joint's noise. Residuals beyond three of it weigh less
(P. Huber, "Robust estimation of a location parameter", 1964). Neighbouring rows share noise, so
standard errors come from sums of scores over overlapping windows (W. Newey, K. West, "A simple,
positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix", 1987).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from stiction_envs.gap.signals.bristle import bristles
from stiction_envs.gap.signals.dataset import Data
from stiction_envs.gap.signals.friction_state import PRESLIDING_DISTANCES
from stiction_envs.robots.regressor import (
    BaseSet,
    base_set,
    inertial_names,
    inertial_parameters,
    torque_regressor,
)

Array = NDArray[np.float64]
ROWS_PER_PERIOD = 5.0
"""Rows kept per period of the filter's cutoff [-]; assumed: more add nothing."""
HUBER = 3.0
"""Residuals beyond this many robust standard deviations weigh less [-]; assumed."""
REWEIGHED = 6
"""Rounds of weights; assumed."""
LEAST_NOISE = 1e-6
"""Least noise of a joint's torque [N·m]; assumed: perfect data do not divide by zero."""
USUAL_FRICTION = 0.1
"""Usual friction at the speed limit over the torque limit [-]; assumed. It matters only for joints
that hardly moved."""
ROTOR_TIME = 0.3
"""Time in which a joint usually comes to its speed limit [s]; assumed."""
STATES_PER_JOINT = 40
"""Random states, over all of the range, from which the base parameters are found; assumed."""
SINGULAR = 1e-13
"""Eigenvalues of the scaled normal equations are rounding below this part of the largest [-];
assumed."""
UNKNOWN = 1e-4
"""A parameter is not known from this part of it on in directions of such eigenvalues [-]; assumed.
"""
CORRELATED = 0.05
"""Rows are independent below this autocorrelation [-]; assumed."""
MOST_LAG = 0.1
"""Longest window of correlated rows, as part of all rows [-]; assumed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """Torques and their columns; T rows of n joints, P parameters."""

    columns: Array
    """(T, n, P): 10 per link, then rotor (if any), Coulomb, viscous and offset, n each."""
    torque: Array
    """(T, n) measured [N·m]."""
    block: NDArray[np.int64]
    """(T,) block to hold out; −1 in a guard."""
    nominal: Array
    """(P,) of the nominal model; friction zero."""
    usual: Array
    """(P − 10 n,) sizes that friction and rotors usually stay under."""
    shared: float
    """Neighbouring rows that share white noise after the filter, at least 1."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.torque.shape[1]

    @property
    def links(self) -> int:
        """Number of inertial parameters, 10 n."""
        return 10 * self.n

    def take(self, rows: NDArray[np.bool_]) -> Design:
        """Return some rows."""
        return replace(
            self, columns=self.columns[rows], torque=self.torque[rows], block=self.block[rows]
        )


def _columns(model: pin.Model, q: Array, dq: Array, ddq: Array, dry: Array, rotor: bool) -> Array:
    """Return (T, n, P) columns as in `Design`, ``dry`` (T, n) being dry friction over its level."""
    kinds = [ddq] if rotor else []
    kinds += [dry, dq, np.ones_like(dq)]
    rows, n = dq.shape
    own = np.zeros((rows, n, len(kinds), n))
    j = np.arange(n)
    for k, column in enumerate(kinds):
        own[:, j, k, j] = column
    return np.concatenate([torque_regressor(model, q, dq, ddq), own.reshape(rows, n, -1)], axis=2)


def _usual(data: Data, rotor: bool) -> Array:
    """Return (k n,) sizes that friction stays under: a part of the torque limit."""
    torque = USUAL_FRICTION * data.arm.limits.torque
    speed = data.arm.limits.velocity
    kinds = [torque * ROTOR_TIME / speed] if rotor else []
    return np.concatenate([*kinds, torque, torque / speed, torque])


def design(
    data: Data,
    *,
    rotor: bool = False,
    distance: Array | None = None,
) -> Design:
    """Return the columns of all parameters along logs.

    Args:
        data: logs beside the nominal model.
        rotor: whether rotors' inertia is seen, that is, torque was measured in front of the gear.
        distance: (n,) presliding distance of dry friction [rad]; None for that of the data.
    """
    step, shared = 1, 1.0
    if np.isfinite(data.dt) and np.isfinite(data.cutoff):
        step = max(1, int(1.0 / (ROWS_PER_PERIOD * data.cutoff * data.dt)))
        shared = max(1.0, 1.0 / (2 * data.cutoff * data.dt * step))
    yields = data.friction.presliding_distance if distance is None else distance
    direction = data.smooth(
        bristles(data.reversal_path, data.runs(), yields[:, None], data.settings.motion)[..., 0]
    )
    rows = slice(None, None, step)
    phi = inertial_parameters(data.pinocchio).ravel()
    usual = _usual(data, rotor)
    return Design(
        columns=_columns(
            data.pinocchio, data.q[rows], data.dq[rows], data.ddq[rows], direction[rows], rotor
        ),
        torque=data.tau[rows],
        block=data.block[rows],
        nominal=np.concatenate([phi, np.zeros(len(usual))]),
        usual=usual,
        shared=shared,
    )


def presliding(data: Data, base: BaseSet, rotor: bool) -> Array:
    """Return (n,) presliding distance by which each joint's torque is fitted best [rad].

    Chosen with free base parameters: with the nominal links, errors of these would decide.
    """
    scores = []
    for distance in PRESLIDING_DISTANCES:
        d = design(data, rotor=rotor, distance=np.full(data.n, distance))
        found = fit(d.columns[:, :, base.kept], d.torque)
        scores.append(np.square(found.residual).mean(axis=0))
    return np.array(PRESLIDING_DISTANCES)[np.argmin(scores, axis=0)]


def structural_base(data: Data, rotor: bool) -> tuple[BaseSet, Array]:
    """Return the base parameters that some motion excites, and (r,) the torque of one unit of each.

    The torque is over its joint's limit, root-mean-square over states all over the range.
    """
    n, limits = data.n, data.arm.limits
    rows = STATES_PER_JOINT * n
    rng = np.random.default_rng(0)
    low, high = limits.position.T
    q = rng.uniform(low, high, (rows, n))
    dq = rng.uniform(-1, 1, (rows, n)) * limits.velocity
    ddq = rng.uniform(-1, 1, (rows, n)) * limits.velocity / ROTOR_TIME
    whole = _columns(data.pinocchio, q, dq, ddq, np.sign(dq), rotor)
    kinds = ("rotor", "Fc", "Fv", "offset") if rotor else ("Fc", "Fv", "offset")
    names = (*inertial_names(n), *(f"{kind}{j}" for kind in kinds for j in range(1, n + 1)))
    base = base_set(whole.reshape(-1, len(names)), names)
    kept = whole[:, :, base.kept] / limits.torque[:, None]
    return base, np.sqrt(np.square(kept).mean(axis=0).max(axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Weighted least squares on r columns."""

    values: Array
    """(r,)."""
    noise: Array
    """(n,) robust standard deviation of the residual [N·m]."""
    weight: Array
    """(T, n) 1/noise², less for outliers [1/(N·m)²]."""
    residual: Array
    """(T, n) [N·m]."""


def fit(columns: Array, torque: Array, usual: Array | None = None) -> Fit:
    """Return robust weighted least squares.

    Args:
        columns: (T, n, r).
        torque: (T, n) [N·m].
        usual: (r,) standard deviation of the values about zero, if they are known to be small.
    """
    prior = 0.0 if usual is None else np.diag(1.0 / np.square(usual))
    noise = np.ones(torque.shape[1])
    weight = np.ones_like(torque)
    values = np.zeros(columns.shape[2])
    for _ in range(REWEIGHED):
        a, b = normal_sums(columns, torque, weight)
        values = _solve(a + prior, b)
        residual = torque - columns @ values
        middle = np.median(residual, axis=0)
        noise = 1.4826 * np.median(np.abs(residual - middle), axis=0)
        noise = np.maximum(noise, LEAST_NOISE)
        far = np.abs(residual) / noise
        weight = np.minimum(1.0, HUBER / np.maximum(far, 1e-12)) / noise**2
    return Fit(values=values, noise=noise, weight=weight, residual=torque - columns @ values)


def normal_sums(columns: Array, torque: Array, weight: Array) -> tuple[Array, Array]:
    """Return XᵀWX (r, r) and XᵀWy (r,)."""
    root = np.sqrt(weight)
    x = (columns * root[:, :, None]).reshape(-1, columns.shape[2])
    return x.T @ x, x.T @ (torque * root).ravel()


def _solve(a: Array, b: Array) -> Array:
    """Return A⁻¹ b, least-norm in scaled columns where A has not full rank."""
    size, values, vectors, keep = _spectrum(a)
    inner = vectors[:, keep] / values[keep] @ vectors[:, keep].T
    return np.asarray(inner @ (b / size) / size)


def _spectrum(a: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Return sizes of the columns, eigenvalues and vectors of A scaled by them, and which count."""
    size = np.sqrt(np.diag(a))
    size[size == 0] = 1.0
    values, vectors = np.linalg.eigh(a / np.outer(size, size))
    return size, values, vectors, values > SINGULAR * values[-1]


def correlated_rows(residual: Array) -> int:
    """Return the number of neighbouring rows that share noise, at least 1."""
    most = max(1, int(MOST_LAG * len(residual)))
    worst = 1
    for e in (residual - residual.mean(axis=0)).T:
        power = np.abs(np.fft.rfft(e, 2 * len(e))) ** 2
        lagged = np.fft.irfft(power)[: most + 1]
        below = np.flatnonzero(lagged < CORRELATED * lagged[0])
        worst = max(worst, int(below[0]) if len(below) else most)
    return min(worst, most)


def standard_errors(columns: Array, found: Fit, shared: float = 1.0) -> tuple[Array, float]:
    """Return (r,) standard errors, and the condition number of the weighted, scaled columns.

    Errors are the larger of two: Newey and West's, which see what the model leaves, and those of
    noise as strong at the motion's frequencies as at all others. The former are too small alone: a
    motion of few frequencies lets the parameters fit much of the noise there. Errors of parameters
    of which the rows say nothing are infinite.

    Args:
        columns: (T, n, r).
        found: its fit.
        shared: number of neighbouring rows that share white noise after the filter.
    """
    a, _ = normal_sums(columns, found.residual, found.weight)
    size, values, vectors, keep = _spectrum(a)
    inverse = vectors[:, keep] / values[keep] @ vectors[:, keep].T / np.outer(size, size)
    scores = np.einsum("tjr,tj->tr", columns, found.weight * found.residual)
    lag = 2 * correlated_rows(found.residual)
    total = np.vstack([np.zeros(scores.shape[1]), np.cumsum(scores, axis=0)])
    rows = np.arange(len(scores) + lag)
    ends = np.minimum(rows + 1, len(scores))
    windows = total[ends] - total[np.maximum(rows + 1 - lag - 1, 0)]
    meat = windows.T @ windows / (lag + 1)
    independent = found.residual.size / correlated_rows(found.residual)
    scale = independent / max(independent - len(values), 1.0)
    variance = np.maximum(np.diag(inverse @ meat @ inverse) * scale, shared * np.diag(inverse))
    errors = np.sqrt(np.maximum(variance, 0.0))
    errors[np.square(vectors[:, ~keep]).sum(axis=1) > UNKNOWN] = np.inf
    least = max(float(values[0]), float(np.finfo(float).eps * values[-1]))
    return errors, float(np.sqrt(values[-1] / least))
