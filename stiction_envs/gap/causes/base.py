"""The face of a cause: what it adds to the torque, what excites it, what its parameters are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from stiction_envs.gap.signals.dataset import Data, rate

Array = NDArray[np.float64]
Shape = tuple[float, ...]
"""Values of a cause's nonlinear parameters; () where it has none."""
MOVING = 0.02
"""A joint that is faster moves for certain [rad/s]; assumed, ten times the sign's width."""
SLOW = 0.01
"""Speed between which and its opposite a joint reverses for certain [rad/s]; assumed."""
STILL = 0.02
"""Span of angles in which a joint only holds [rad]; assumed."""
MUCH = 0.02
"""Least part of the samples in which a cause must act [-]; assumed."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a cause, as in ``diagnosis.json``."""

    name: str
    unit: str
    low: float = -np.inf
    high: float = np.inf
    size: int = 1
    """Numbers it holds."""
    neutral: float = 0.0
    """Value at which nothing is wrong."""


EDGE = 1.02
"""Nonlinear parameters within this factor of the last that were tried stand at the end [-]."""


class Cause(ABC):
    """Something that simulations leave out or get wrong.

    It adds columns (T, k) times coefficients (k,) to the residual torque, measured less nominal.
    """

    name: ClassVar[str]
    what: ClassVar[str]
    """What is wrong in the simulation, a clause."""
    record: ClassVar[str]
    """The motion that shows it and tells it from others, a clause."""
    arm_wide: ClassVar[bool] = False
    """One hypothesis with the same coefficients in all joints."""
    tied: ClassVar[int] = 0
    """How many of its numbers, linear and not, are no free choice beside the others."""
    fickle: ClassVar[bool] = False
    """Whether neighbours among its nonlinear parameters foretell quite different torques."""
    coupled: ClassVar[bool] = False
    """A cause of one joint that all joints' torques show: `spread` in place of `columns`."""
    sharpen: ClassVar[bool] = True
    """Whether its nonlinear parameter is a number that can be refined between those tried."""
    plain: ClassVar[bool] = True
    """Whether it has no nonlinear parameter."""
    alone: ClassVar[bool] = True
    """Whether it may stand without what it `needs`, where that is found not to be there."""
    rough: ClassVar[bool] = False
    """Whether its law is only a likeness, so that little things beside it mean nothing."""
    lags: ClassVar[bool] = False
    """Whether a delay at its full size may look like it, as long as the delay is not known."""
    law: ClassVar[bool] = False
    """Whether it belongs to the common law of friction, and is no refinement of it."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Causes that are in the model of a joint wherever this one is."""
    parameters: ClassVar[tuple[Parameter, ...]]

    @abstractmethod
    def columns(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return (T, k) torque per unit of each coefficient on a joint (from 0)."""

    def spread(self, data: Data, joint: int, shape: Shape) -> Array:
        """Return (T, n, k) torque on all joints of a `coupled` cause on one joint."""
        raise NotImplementedError

    @abstractmethod
    def values(self, coefficients: Array, shape: Shape) -> dict[str, float | list[float]]:
        """Return the parameters of coefficients (k,) and nonlinear parameters."""

    def said(self, coefficients: Array) -> str:
        """Return `what`, for these coefficients."""
        return self.what

    def bounds(self, data: Data, joint: int) -> tuple[Array, Array]:
        """Return lowest and highest coefficients, (k,) each; by default the parameters'.

        ``joint`` counts from 0 and is -1 for causes of the whole arm.
        """
        low = [p.low for p in self.parameters for _ in range(p.size)]
        high = [p.high for p in self.parameters for _ in range(p.size)]
        return np.array(low), np.array(high)

    def shapes(self, data: Data, joint: int, residual: Array) -> list[Shape]:
        """Return the nonlinear parameters to try.

        Args:
            data: the logs.
            joint: from 0.
            residual: (T,) what is left when the common linear causes are taken out [N·m].
        """
        return [()]

    def between(self, shape: Shape, shapes: list[Shape]) -> tuple[float, float]:
        """Return the neighbours of a nonlinear parameter, between which it is refined."""
        tried = sorted(s[0] for s in shapes)
        at = tried.index(shape[0])
        return tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]

    def grown(self, shape: Shape, coefficients: Array, level: float) -> Shape:
        """Return the nonlinear parameters of a cause of this size on that dry friction [N·m]."""
        return shape

    def small(self, coefficients: Array, shape: Shape) -> bool:
        """Whether it is too small to be told from how simulations and logs are timed."""
        return False

    def bounded(self, coefficients: Array, data: Data, joint: int) -> bool:
        """Whether what it is about stands on a bound: then it is something else, or nothing."""
        low, high = self.bounds(data, joint)
        return bool(np.any((coefficients <= low) | (coefficients >= high)))

    def at_edge(self, shape: Shape, shapes: list[Shape]) -> bool:
        """Whether a nonlinear parameter stands at the end of what was tried."""
        if len(shapes) < 2 or not shape:
            return False
        tried = sorted({s[0] for s in shapes})
        if tried[0] <= 0:
            return shape[0] in (tried[0], tried[-1])
        # refined ones come close to the end without reaching it
        return not tried[0] * EDGE < shape[0] < tried[-1] / EDGE

    def alike(self, data: Data, joint: int) -> tuple[str, ...]:
        """Return causes that are the same on this joint, whatever else is in the model."""
        return ()

    def lacking(self, data: Data, joint: int) -> str:
        """Return why these data cannot show the cause on a joint, or nothing."""
        return ""


def moving(data: Data, joint: int) -> NDArray[np.bool_]:
    """Return (T,) where a joint moves for certain."""
    return np.asarray(np.abs(data.dq[:, joint]) > MOVING)


def rests(data: Data, joint: int) -> bool:
    """Whether a joint holds its angle throughout: friction then bears any torque up to its own."""
    span = float(np.ptp(np.percentile(data.q[:, joint], [1, 99])))
    return bool(moving(data, joint).mean() < MUCH) and span < STILL


def turns(signal: Array, dead: float) -> int:
    """Return how often a signal (T,) goes from one side of ±``dead`` to the other."""
    side = np.sign(signal[np.abs(signal) > dead])
    return int(np.count_nonzero(np.diff(side)))


def lacks_both_directions(data: Data, joint: int) -> str:
    """Return why friction cannot be seen, or nothing."""
    v = data.dq[:, joint]
    if min((v > MOVING).mean(), (v < -MOVING).mean()) < MUCH:
        return f"joint {joint + 1} does not move in both directions"
    return ""


def changes(data: Data, torque: Array) -> NDArray[np.bool_]:
    """Return (n,) where a torque (T, n) changes by more than noise hides; a constant is an offset.

    Three times the noise floor, as for what a blind study calls visible (assumed).
    """
    return np.asarray(torque[data.block >= 0].std(axis=0) > 3 * data.noise)


def log_grid(low: float, high: float, count: int) -> list[Shape]:
    """Return values spread evenly in the logarithm."""
    return [(float(x),) for x in np.geomspace(low, high, count)]


def along_runs(data: Data, signal: Array) -> Array:
    """Return the time derivative of (T, ...) within each segment, per second."""
    return rate(signal, data.runs(), data.dt)
