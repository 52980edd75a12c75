"""Whether what was predicted came: the slope of one over the other, in standard errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def came_true(pe: Array, pp: Array) -> tuple[Array, Array]:
    """Return (n,) the part of a predicted torque that came true, and its standard error [-].

    Args:
        pe: (B, n) sums over blocks of predicted torque times what is left without it.
        pp: (B, n) of predicted torque squared.

    Returns:
        Σpe/Σpp, and √(Σ(pe − a pp)²·B/(B − 1))/Σpp between blocks (K.-Y. Liang, S. Zeger,
        "Longitudinal data analysis using generalized linear models", Biometrika 1986); NaN
        without a torque, an infinite error with a single block.
    """
    total = pp.sum(axis=0)
    some = np.where(total > 0, total, np.nan)
    a = pe.sum(axis=0) / some
    if len(pp) < 2:
        return a, np.where(np.isnan(a), np.nan, np.inf)
    spread = np.sqrt(np.square(pe - a * pp).sum(axis=0) * len(pp) / (len(pp) - 1))
    return a, spread / some


def slope(pe: Array, pp: Array) -> float:
    """Return the slope of what came over what was predicted, in standard errors: see `came_true`.

    Args:
        pe: (B,) prediction times what was left, summed over each block.
        pp: (B,) prediction squared.
    """
    if float(pp.sum()) <= 0 or len(pp) < 2:
        return 0.0
    a, error = (float(x[0]) for x in came_true(pe[:, None], pp[:, None]))
    return a / max(error, 1e-12)
