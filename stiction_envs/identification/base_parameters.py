"""Base parameters of links and friction: which there are, and their values with errors.

Torques determine only sums of parameters (`robots.regressor.base_set`). Their values are least
squares on the logs without a prior, over the same sums of squares as a diagnosis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from stiction_envs.gap.linear.bounded_fit import RIDGE
from stiction_envs.gap.linear.grams import Gram
from stiction_envs.gap.linear.joint_grams import JointGrams
from stiction_envs.gap.linear.model_columns import ModelColumns
from stiction_envs.gap.selection.candidates import RegressorLibrary
from stiction_envs.robots import Arm
from stiction_envs.robots.regressor import BaseSet, base_set, inertial_names, torque_regressor

Array = NDArray[np.float64]
SPEED_UP_TIME = 0.3
"""Time in which a joint usually comes to its speed limit [s]; assumed."""
STATES_PER_JOINT = 40
"""Random states, over all of the range, from which the base parameters are found; assumed."""
UNKNOWN = 1e-2
"""A parameter is not known where its variance, over that without all other parameters, is this
part of what the ridge allows at most [-]; assumed."""


def columns_of(model: pin.Model, q: Array, dq: Array, ddq: Array, own: Array) -> Array:
    """Return (T, n, 10 n + k n) torque per parameter: ten per link, then k per joint.

    Args:
        model: the arm.
        q: (T, n) [rad].
        dq: (T, n) [rad/s].
        ddq: (T, n) [rad/s²].
        own: (T, n, k) torque per parameter of a joint's own: rotor, friction, offset.
    """
    joints = np.einsum("tjk,ji->tjki", own, np.eye(own.shape[1]))
    links = torque_regressor(model, q, dq, ddq)
    return np.concatenate([links, joints.reshape(*own.shape[:2], -1)], axis=2)


def structural_base(arm: Arm, kinds: tuple[str, ...]) -> tuple[BaseSet, Array]:
    """Return the base parameters that some motion excites, and (r,) the torque of one unit of each.

    The torque is over its joint's limit, root-mean-square over states all over the range.

    Args:
        arm: the arm.
        kinds: parameters of each joint, a part of "rotor", "Fc", "Fv", "offset".
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
    """(1 + B, r) of all blocks, and of all but each."""
    errors: Array
    """(r,) standard errors; infinite for parameters of which the rows say nothing."""
    condition: float
    """Condition number of the weighted columns, scaled to unit length [-]."""


def fit_base(library: RegressorLibrary, columns: Array) -> BaseFit:
    """Return least squares of the measured torque, with a library's weights and noise.

    The variance is that of noise that neighbouring rows share, or the mean of it and of the
    jackknife over blocks, if that is larger. The former does not see what the model leaves at the
    motion's own frequencies; the latter is too large for few blocks (B. Efron, C. Stein, "The
    jackknife estimate of variance", Annals of Statistics 1981).

    Args:
        library: of the logs; its ``inflation`` is by what a model like this leaves.
        columns: (T, n, r) torque per base parameter.
    """
    data, r = library.data, columns.shape[2]
    weight = library.weight / np.square(data.noise)
    sums = [
        Gram.of(columns[:, j], data.tau[:, j], data.block, weight[:, j], data.blocks)
        for j in range(data.n)
    ]
    grams, every = JointGrams(sums, library.inflation), (tuple(range(r)),) * data.n
    model = ModelColumns(every, every, (-np.inf,) * r, (np.inf,) * r)
    variance, square = np.diag(grams.covariance(model)), grams.system(model)[0]
    size = np.sqrt(np.maximum(np.diag(square), 1e-200))
    values = np.linalg.eigvalsh(square / np.outer(size, size))
    least = max(float(values[0]), float(np.finfo(float).eps * values[-1]))
    without = grams.leave_one_block_out(model)
    jackknife = (data.blocks - 1) * without.var(axis=0)
    known = variance * size**2 < UNKNOWN / RIDGE
    return BaseFit(
        values=np.vstack([grams.fit(model), without]),
        errors=np.where(known, np.sqrt(np.maximum(variance, (variance + jackknife) / 2)), np.inf),
        condition=float(np.sqrt(values[-1] / least)),
    )
