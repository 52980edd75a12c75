"""The likeliest parameters of a joint given its measured angle (output error); their evidence.

Parameters are counted in sizes of their priors, z; what is minimised is −ln p + |z|²/2, by
Levenberg-Marquardt steps. Every iteration simulates all derivatives, then all steps, in one batch.
The evidence is Laplace's.

Errors last, and some stretches of time are worse than others. Time is cut into blocks, whose errors
are Gaussian, of sizes that scatter: the likelihood of a block is Student's t (docs/theory.md). A
burst of errors (a joint that sticks and slips) is one block of many: what takes the burst off gains
the logarithm of its size only.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stiction_envs.arrays import Array, Bools, Index
from stiction_envs.gap.servo.joint import JointMotion
from stiction_envs.gap.servo.servo_parameters import INDEX, PARAMETERS

DIFFERENCE = 0.02
"""Difference of a derivative, over the size of the prior [-]; assumed."""
DAMPINGS = np.array([0.1, 1.0, 10.0, 100.0])
"""Damping of the steps that are tried at once, over the last one [-]; assumed."""
TURN = 6.0
"""Error of a joint that diverged: about a turn [rad]; assumed."""
LEAST_GAIN = 0.05
"""A fit ends when a step gains less [nats]; assumed."""

BLOCK = 2.0
"""Length of a block [s]; assumed: longer than a servo's error lasts in most motions."""
ALIKE = 4.0
"""Degrees of freedom ν of the sizes of blocks [-]; assumed: a block's error is half to twice the
usual one in four of five."""
LEAST_LAST = 0.125
"""Least time for which errors last [s]; assumed: time constants of a servo are not resolved."""
BISECTIONS = 40
RATIO = np.array([p.scale == "ratio" for p in PARAMETERS.values()])
"""(P,) whether a parameter's size is of its logarithm."""


class Noise:
    """Blocks of the rows of a motion that count, and what no model has."""

    def __init__(
        self, motion: JointMotion, counts: Bools, floor: float, last: float = LEAST_LAST
    ) -> None:
        """Cut the time of a motion into blocks.

        Args:
            motion: of the joint.
            counts: (T,) rows that count.
            floor: error that every model leaves [rad].
            last: time for which errors last [s].
        """
        self.counts, self.floor, self.last, self.step = counts, floor, last, motion.step
        keys = np.stack([motion.segment, motion.since // BLOCK])[:, counts]
        self.block = np.zeros(len(motion.t), dtype=np.int64)
        """(T,) number of each row's block."""
        _, number = np.unique(keys, axis=1, return_inverse=True)
        self.block[counts] = number.ravel()
        self.rows = np.maximum(np.bincount(self.block[counts]), 1).astype(np.float64)
        """(B,) number of those in each block, at least one."""
        self.observations = self.rows * motion.step / (2.0 * last)
        """(B,) independent observations."""

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Coordinates:
    """Free parameters of a joint in sizes of their priors; the others are fixed."""

    base: Array
    """(P,) all parameters; those that are free do not count."""
    at: Index
    """(F,) numbers of the free ones."""
    centre: Array
    """(F,) means of their priors."""
    size: Array
    """(F,) standard deviations, of the logarithm for those of `RATIO`."""
    lowest: Array
    """(P,) bounds of all parameters."""
    highest: Array

    @property
    def ratio(self) -> Bools:
        """(F,) whether a size is of the logarithm."""
        return RATIO[self.at]

    @cached_property
    def low(self) -> Array:
        """(F,) lowest z."""
        return self._z(self.lowest)

    @cached_property
    def high(self) -> Array:
        """(F,) highest z."""
        return self._z(self.highest)

    def fixed(self, number: int) -> "Coordinates":
        """Return the coordinates without one parameter, if it is free."""
        kept = self.at != number
        return replace(self, at=self.at[kept], centre=self.centre[kept], size=self.size[kept])

    def parameters(self, z: Array) -> Array:
        """Return (C, P) parameters of (C, F) coordinates."""
        out = np.repeat(self.base[None], len(z), axis=0)
        moved = np.asarray(self.size * z)
        factor = np.exp(np.where(self.ratio, moved, 0.0))
        moved = np.where(self.ratio, self.centre * factor, self.centre + moved)
        out[:, self.at] = moved
        return out

    def z(self, parameters: Array) -> Array:
        """Return (F,) coordinates of (P,) parameters, within bounds."""
        return np.clip(self._z(parameters), self.low, self.high)

    def _z(self, parameters: Array) -> Array:
        x = parameters[self.at]
        ratio = np.log(np.where(self.ratio, x, 1.0) / np.where(self.ratio, self.centre, 1.0))
        return np.where(self.ratio, ratio, x - self.centre) / self.size


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """The most likely parameters of one joint under one choice of causes."""

    coordinates: Coordinates
    z: Array
    """(F,)."""
    parameters: Array
    """(P,), in the order of `servo_parameters.NAMES`."""
    angle: Array
    """(T,) simulated angle [rad]."""
    error: Array
    """(T,) measured less simulated angle [rad]."""
    slopes: Array
    """(F, T) change of the angle per unit of z [rad]."""
    weights: Array
    """(T,) of the rows."""
    log_likelihood: float
    """[nats]."""

    @property
    def precision(self) -> Array:
        """(F, F) inverse covariance of z."""
        return (self.slopes * self.weights) @ self.slopes.T + np.eye(len(self.z))

    @property
    def evidence(self) -> float:
        """Log evidence by Laplace's approximation [nats], but for a constant."""
        return float(
            self.log_likelihood - 0.5 * self.z @ self.z - 0.5 * np.linalg.slogdet(self.precision)[1]
        )

    def given(self, name: str) -> "Fit":
        """Return the fit with a parameter held at its value."""
        kept = self.coordinates.at != INDEX[name]
        coordinates = replace(self.coordinates.fixed(INDEX[name]), base=self.parameters)
        return replace(self, coordinates=coordinates, z=self.z[kept], slopes=self.slopes[kept])

    def __getitem__(self, name: str) -> float:
        """Return a parameter by its name."""
        return float(self.parameters[INDEX[name]])


def fit(motion: JointMotion, noise: Noise, of: Coordinates, starts: Array, iterations: int) -> Fit:
    """Fit the free parameters from the best of (C, P) starts."""
    z_all = np.stack([of.z(p) for p in starts])
    angles = motion.simulate(of.parameters(z_all))
    costs = _costs(motion, noise, angles, z_all)
    k = int(np.argmin(costs))
    z, angle, cost, damping = z_all[k], angles[k], float(costs[k]), 1e-2
    slopes = derivatives(motion, of, z, angle)
    for _ in range(iterations if len(z) else 0):
        error = _error(motion, angle)
        weights = noise.weights(error)
        hessian = (slopes * weights) @ slopes.T + np.eye(len(z))
        gradient = slopes @ (weights * error) - z
        gained = 0.0
        for _ in range(2):
            tried = _steps(z, hessian, gradient, damping * DAMPINGS, of)
            angles = motion.simulate(of.parameters(tried))
            costs = _costs(motion, noise, angles, tried)
            k = int(np.argmin(costs))
            gained = cost - float(costs[k])
            if gained > 0:
                break
            damping *= 1e3
        if gained <= 0:
            break
        z, angle, cost = tried[k], angles[k], float(costs[k])
        damping = max(damping * DAMPINGS[k], 1e-7)
        slopes = derivatives(motion, of, z, angle)
        if gained < LEAST_GAIN:
            break
    error = _error(motion, angle)
    return Fit(
        coordinates=of,
        z=z,
        parameters=of.parameters(z[None])[0],
        angle=angle,
        error=error,
        slopes=slopes,
        weights=noise.weights(error),
        log_likelihood=0.5 * float(z @ z) - cost,
    )


def derivatives(motion: JointMotion, of: Coordinates, z: Array, angle: Array) -> Array:
    """Return (F, T) change of the angle per unit of z [rad]."""
    sign = np.where(z + DIFFERENCE > of.high, -1.0, 1.0)
    varied = z + np.diag(sign * DIFFERENCE)
    change = motion.simulate(of.parameters(varied)) - angle
    change = np.clip(np.nan_to_num(change, posinf=0.0, neginf=0.0), -TURN, TURN)
    return np.asarray(change * (sign / DIFFERENCE)[:, None])


def _error(motion: JointMotion, angle: Array) -> Array:
    """Return measured less simulated angle; a joint that diverged is a turn off [rad]."""
    return np.asarray(np.clip(np.nan_to_num(motion.q - angle, nan=TURN), -TURN, TURN))


def _costs(motion: JointMotion, noise: Noise, angles: Array, z: Array) -> Array:
    errors = np.stack([_error(motion, angle) for angle in angles])
    return 0.5 * np.square(z).sum(axis=1) - noise.log_likelihood(errors)


def _steps(z: Array, hessian: Array, gradient: Array, dampings: Array, of: Coordinates) -> Array:
    """Return one z per damping; coordinates on a bound that push outward stay."""
    out = np.repeat(z[None], len(dampings), axis=0)
    diagonal = np.diag(np.diag(hessian))
    for row, damping in zip(out, dampings, strict=True):
        moving = np.ones(len(z), dtype=bool)
        x = np.zeros(len(z))
        for _ in range(len(z)):
            m = np.flatnonzero(moving)
            x[:] = 0.0
            if len(m) == 0:
                break
            x[m] = np.linalg.solve((hessian + damping * diagonal)[np.ix_(m, m)], gradient[m])
            new = z + x
            outward = (new < of.low) & (z <= of.low) | (new > of.high) & (z >= of.high)
            if not (outward & moving).any():
                break
            moving &= ~outward
        row[:] = np.clip(z + x, of.low, of.high)
    return out
