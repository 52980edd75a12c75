"""Base parameters of links and friction: which there are, and their values with errors.

Torques determine only sums of parameters (`robots.regressor.base_set`). Their values are least
squares on the logs without a prior, over the same sums of squares as a diagnosis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stiction_envs.arrays import Array
from stiction_envs.gap.predictors.torque import FOLDS, TorquePredictor
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import BaseSet, base_set, inertial_names, torque_regressor

SPEED_UP_TIME = 0.3
"""Time in which a joint usually comes to its speed limit [s]; assumed."""
STATES_PER_JOINT = 40
"""Random states, over all of the range, from which the base parameters are found; assumed."""
UNKNOWN = 1e-7
"""Part of a parameter's information that is its own, apart from all others, below which it is
rounding [-]; assumed."""


def columns_of(model: pin.Model, q: Array, dq: Array, ddq: Array, own: Array) -> Array:
    """Return (T, n, 10 n + k n) torque per parameter: ten per link, then k per joint.

    q, dq, ddq are (T, n) [rad, s]; ``own`` (T, n, k) is torque per parameter of a joint's own:
    rotor, friction, offset.
    """
    joints = np.einsum("tjk,ji->tjki", own, np.eye(own.shape[1]))
    links = torque_regressor(model, q, dq, ddq)
    return np.concatenate([links, joints.reshape(*own.shape[:2], -1)], axis=2)


def structural_base(arm: Arm, kinds: tuple[str, ...]) -> tuple[BaseSet, Array]:
    """Return the base parameters that some motion excites, and (r,) the torque of one unit of each.

    The torque is over its joint's limit, root mean square over states all over the range; ``kinds``
    are parameters of each joint, a part of "rotor", "Fc", "Fv", "offset".
    """
    n, limits = arm.n, arm.limits
    rows = STATES_PER_JOINT * n
    rng = np.random.default_rng(0)
    low, high = limits.position.T
    q = rng.uniform(low, high, (rows, n))
    dq = rng.uniform(-1, 1, (rows, n)) * limits.velocity
    ddq = rng.uniform(-1, 1, (rows, n)) * limits.velocity / SPEED_UP_TIME
    own = {"rotor": ddq, "Fc": np.sign(dq), "Fv": dq, "offset": np.ones_like(q)}
    whole = columns_of(arm.pinocchio(), q, dq, ddq, np.stack([own[k] for k in kinds], axis=2))
    names = (*inertial_names(n), *(f"{kind}{j}" for kind in kinds for j in range(1, n + 1)))
    base = base_set(whole.reshape(-1, len(names)), names)
    kept = whole[:, :, base.kept] / limits.torque[:, None]
    return base, np.sqrt(np.square(kept).mean(axis=0).max(axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class BaseFit:
    """Least squares on r base parameters, without a prior."""

    values: Array
    """(1 + F, r) of all folds, and of all but each."""
    errors: Array
    """(r,) standard errors; infinite for parameters of which the rows say nothing."""
    condition: float
    """Condition number of the weighted columns, scaled to unit length [-]."""


def fit_base(predictor: TorquePredictor, columns: Array) -> BaseFit:
    """Return least squares of the measured torque on columns (T, n, r), by a predictor's weights.

    The variance is that of noise that neighbouring rows share, or the mean of it and of the
    jackknife over folds, if that is larger. The former does not see what the model leaves at the
    motion's own frequencies; the latter is too large for few folds (B. Efron, C. Stein, "The
    jackknife estimate of variance", Annals of Statistics 1981).
    """
    data, r = predictor.data, columns.shape[2]
    xx, xr = np.zeros((FOLDS, r, r)), np.zeros((FOLDS, r))
    for j, channel in enumerate(predictor.problem.channels):
        weight = channel.weight / predictor.problem.inflation[j]
        for f in range(FOLDS):
            rows = predictor.fold == f
            own = columns[rows, j]
            xx[f] += own.T @ (own * weight[rows, None])
            xr[f] += own.T @ (data.tau[rows, j] * weight[rows])
    whole, along = xx.sum(axis=0), xr.sum(axis=0)
    size = np.sqrt(np.maximum(np.diag(whole), 1e-200))
    across = np.outer(size, size)

    def fitted(square: Array, target: Array) -> Array:
        return np.linalg.lstsq(square / across, target / size, rcond=UNKNOWN)[0] / size

    eigenvalues, v = np.linalg.eigh(whole / across)
    least = max(float(eigenvalues[0]), float(np.finfo(float).eps * eigenvalues[-1]))
    seen = eigenvalues > UNKNOWN
    variance = (np.square(v[:, seen]) / eigenvalues[seen]).sum(axis=1) / size**2
    # neighbours within half a period of the filter depend on each other
    variance *= max(1.0, 0.5 / (data.cutoff * data.dt)) / predictor.rows
    known = np.square(v[:, ~seen]).sum(axis=1) < UNKNOWN
    without = np.array([fitted(whole - x, along - y) for x, y in zip(xx, xr, strict=True)])
    jackknife = (FOLDS - 1) * without.var(axis=0)
    return BaseFit(
        values=np.vstack([fitted(whole, along), without]),
        errors=np.where(known, np.sqrt(np.maximum(variance, (variance + jackknife) / 2)), np.inf),
        condition=float(np.sqrt(eigenvalues[-1] / least)),
    )
