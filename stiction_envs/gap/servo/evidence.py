"""How likely a joint's residual is: errors last, and some stretches of time are worse than others.

Time is cut into blocks, whose errors are Gaussian, of sizes that scatter: the likelihood of a block
is Student's t (docs/theory.md). A burst of errors (a joint that sticks and slips) is one block of
many: what takes the burst off gains the logarithm of its size only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.servo.joint import JointMotion

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]
Index = NDArray[np.int64]
BLOCK = 2.0
"""Length of a block [s]; assumed: longer than a servo's error lasts in most motions."""
ALIKE = 4.0
"""Degrees of freedom ν of the sizes of blocks [-]; assumed: a block's error is half to twice the
usual one in four of five."""
LEAST_LAST = 0.125
"""Least time for which errors last [s]; assumed: time constants of a servo are not resolved."""
BISECTIONS = 40


@dataclass(frozen=True, kw_only=True, eq=False)
class Noise:
    """Blocks of the rows of a motion that count, and what no model has."""

    block: Index
    """(T,) number of each row's block."""
    counts: Rows
    """(T,) rows that count."""
    rows: Array
    """(B,) number of those in each block, at least one."""
    observations: Array
    """(B,) independent observations."""
    floor: float
    """Error that every model leaves [rad]."""
    step: float
    """Time between rows [s]."""
    last: float
    """Time for which errors last [s]."""

    @classmethod
    def of(cls, motion: JointMotion, counts: Rows, floor: float, last: float = LEAST_LAST) -> Noise:
        """Cut the time of a motion into blocks."""
        t, bounds = motion.t, motion.bounds
        segment = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
        since = t - t[bounds[segment]]
        keys = np.stack([segment, since // BLOCK])[:, counts]
        block = np.zeros(len(t), dtype=np.int64)
        _, number = np.unique(keys, axis=1, return_inverse=True)
        block[counts] = number.ravel()
        rows = np.maximum(np.bincount(block[counts]), 1).astype(np.float64)
        return cls(
            block=block,
            counts=counts,
            rows=rows,
            observations=rows * motion.step / (2.0 * last),
            floor=floor,
            step=motion.step,
            last=last,
        )

    def squares(self, errors: Array) -> Array:
        """Return (C, B) mean squares of the blocks of errors (C, T), with what no model has."""
        some = [np.bincount(self.block[self.counts], weights=e[self.counts] ** 2) for e in errors]
        return np.asarray(some) / self.rows + self.floor**2

    def size(self, squares: Array) -> Array:
        """Return (C,) usual variance of the largest likelihood for (C, B) mean squares."""
        n = self.observations
        low, high = np.log(squares.min(axis=1)) - 5.0, np.log(squares.max(axis=1)) + 5.0
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            x = n * squares / (ALIKE * np.exp(middle)[:, None])
            rises = ((ALIKE + n) * x / (1.0 + x) - n).sum(axis=1) > 0
            low, high = np.where(rises, middle, low), np.where(rises, high, middle)
        return np.exp(0.5 * (low + high))

    def log_likelihood(self, errors: Array) -> Array:
        """Return (C,) log likelihood of errors (C, T) [nats], but for a constant."""
        squares, n = self.squares(errors), self.observations
        size = self.size(squares)[:, None]
        return np.asarray(
            -0.5
            * (n * np.log(size) + (ALIKE + n) * np.log1p(n * squares / (ALIKE * size))).sum(axis=1)
        )

    def weights(self, error: Array) -> Array:
        """Return (T,) weights of rows: minus twice the log likelihood is near Σ w e²."""
        squares, n = self.squares(error[None]), self.observations
        size = self.size(squares)[0]
        each = n * (ALIKE + n) / (ALIKE * size + n * squares[0]) / self.rows
        return np.asarray(each[self.block] * self.counts)

    def lasts(self, error: Array) -> float:
        """Return for how long errors last [s]: the integral of their autocorrelation.

        All blocks count alike, and no error is followed beyond the length of one.
        """
        usual = np.sqrt(self.squares(error[None])[0])[self.block]
        u = np.where(self.counts, error / usual, 0.0)
        power = max(float(u @ u), 1e-12)  # a joint that rests may have no error
        total = 0.5
        for k in range(1, min(len(u), round(BLOCK / self.step))):
            part = float(u[k:] @ u[:-k]) / power
            if part < 0.05:
                break
            total += part
        return max(LEAST_LAST, total * self.step)
