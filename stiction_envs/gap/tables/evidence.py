"""The evidence of a model of one joint's readings, with noise as large as makes it most likely.

    y = Σ columns · N(0, 1) + e

The error e of the readings has two parts, both in units of friction: scatter from reading to
reading, and what no model has, common to the readings of one dither frequency and scale. Their
sizes are those of greatest evidence among some, each with its prior: a model that leaves much
has large errors, and pays for that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
SCATTERS = np.sqrt(2.0) ** np.arange(-3, 9)
"""Scatters that are tried, over the usual one [-]; assumed."""
SCATTER_SPREAD = 0.7
"""Prior size of the logarithm of the scatter [-]; assumed."""
COMMONS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Common errors that are tried, over the usual scatter [-]; assumed."""
Size = tuple[float, float]
SIZES: tuple[Size, ...] = tuple((float(s), c) for s in SCATTERS for c in COMMONS)
COMMON_MEAN = 1.0
"""Prior mean of the common error over the usual scatter (exponential) [-]; assumed."""


class JointEvidence:
    """Normal equations of a joint's readings for each size of the errors."""

    def __init__(
        self,
        columns: Array,
        residual: Array,
        block: Index,
        scatter: float,
        sizes: Sequence[Size] = SIZES,
    ) -> None:
        """Whiten.

        Args:
            columns: (rows, P) effect of each unknown at one standard deviation of its prior, over
                friction [-].
            residual: (rows,) measured less predicted with all unknowns 0, over friction [-].
            block: (rows,) which readings have a common error; alone if negative.
            scatter: usual scatter of a reading over friction [-].
            sizes: of both errors over the usual scatter, to be tried.
        """
        y = np.column_stack([columns, residual])
        s2, c2 = np.square(scatter * np.array(sizes)).T[:, :, None]
        blocks = [block == k for k in np.unique(block[block >= 0])]
        count = np.array([some.sum() for some in blocks])
        total = np.array([y[some].sum(axis=0) for some in blocks]).reshape(len(blocks), y.shape[1])
        # the inverse of s² + c² within a block (Sherman, Morrison)
        share = c2 / (s2 + count * c2)
        common = np.einsum("gb,bp,bq->gpq", share, total, total, optimize=True)
        self.sums = (y.T @ y - common) / s2[:, :, None]
        """(sizes, P + 1, P + 1) normal equations; the last row and column are the residual's."""
        prior = [-0.5 * (np.log(s) / SCATTER_SPREAD) ** 2 - c / COMMON_MEAN for s, c in sizes]
        volume = len(y) * np.log(s2[:, 0]) + np.log1p(count * c2 / s2).sum(axis=1)
        self.volume = np.array(prior) - 0.5 * volume
        """(sizes,) log evidence without the misfit [nats]."""

    def of(self, active: Sequence[int]) -> Array:
        """Return (sizes,) log evidence with some columns [nats]."""
        m, b = self._normal(active)
        explained = np.einsum("gi,gi->g", b, np.linalg.solve(m, b[..., None])[..., 0])
        misfit = self.sums[:, -1, -1] - explained
        return np.asarray(self.volume - 0.5 * (misfit + np.linalg.slogdet(m)[1]))

    def best(self, active: Sequence[int]) -> float:
        """Return the log evidence with some columns, at the best size of the errors [nats]."""
        return float(self.of(active).max())

    def with_each(self, active: Sequence[int]) -> Array:
        """Return (P,) log evidence with some columns and one more, each [nats]."""
        width, pull = self._beside(active)
        gain = 0.5 * (pull**2 / width - np.log(width))
        return np.asarray((self.of(active)[:, None] + gain).max(axis=0))

    def shown(self, active: Sequence[int]) -> tuple[Array, Array]:
        """Return (P,) mean and standard deviation of each unknown beside some, over its prior's."""
        k = int(self.of(active).argmax())
        width, pull = self._beside(active)
        return pull[k] / width[k], width[k] ** -0.5

    def _beside(self, active: Sequence[int]) -> tuple[Array, Array]:
        """Return (sizes, P) precision and gradient of each unknown beside some."""
        m, _ = self._normal(active)
        shared = self.sums[:, list(active), :]
        solved = np.linalg.solve(m, shared)
        width = 1 + np.einsum("gpp->gp", self.sums) - np.einsum("gap,gap->gp", shared, solved)
        pull = self.sums[:, :, -1] - np.einsum("gap,ga->gp", shared, solved[..., -1])
        return width[:, :-1], pull[:, :-1]

    def fit(self, active: Sequence[int]) -> Array:
        """Return (active,) the most likely unknowns, over their prior size."""
        k = int(self.of(active).argmax())
        m, b = self._normal(active)
        return np.asarray(np.linalg.solve(m[k], b[k]))

    def _normal(self, active: Sequence[int]) -> tuple[Array, Array]:
        some = np.array(active, dtype=np.int64)
        return np.eye(len(some)) + self.sums[:, some[:, None], some], self.sums[:, some, -1]
