"""Whether what was predicted came: the slope of one over the other, in standard errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def slope(pe: Array, pp: Array) -> float:
    """Return the slope of what came over what was predicted, in standard errors.

    Its standard error is that between blocks, √(Σ(pᵀe − a pᵀp)²·B/(B − 1))/Σpᵀp (Liang and Zeger,
    "Longitudinal data analysis using generalized linear models", 1986).

    Args:
        pe: (B,) prediction times what was left, summed over each block.
        pp: (B,) prediction squared.
    """
    total = float(pp.sum())
    if total <= 0 or len(pp) < 2:
        return 0.0
    a = float(pe.sum()) / total
    error = float(np.sqrt(np.sum(np.square(pe - a * pp)) * len(pp) / (len(pp) - 1))) / total
    return a / max(error, 1e-12)
