"""What the GTE environment measures while N arms move: tracking error, shaking, the window's sum.

The experiment's own `Accumulator`, fed from step to step.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.gte.accumulator import Accumulator
from stiction_envs.experiments.gte.protocol import GTEProtocol
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.experiments.gte.sampling import Sampler

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass
class PathTrace:
    """One path, kept to be drawn; lists of one array per step."""

    time: list[Array] = field(default_factory=list)
    """(S,) of the samples [s]."""
    error: list[Array] = field(default_factory=list)
    """(S, 6) [m, rad]."""
    position: list[Array] = field(default_factory=list)
    """(S, 3) of the flange [m]."""
    amplitude: list[Array] = field(default_factory=list)
    """(1, n) of the step's dither [N·m]."""


class Recorder(Accumulator):
    """Advances a rig by environment steps and keeps account of each of its N arms."""

    def __init__(
        self, rig: GTERig, protocol: GTEProtocol, *, steps: int, capacity: int, record: bool
    ) -> None:
        """Prepare for environment steps of ``steps`` control steps.

        Args:
            rig: the arms.
            protocol: says what is sampled and when a run is over.
            steps: a multiple of the control steps of a sample.
            capacity: most goals of a path.
            record: whether traces are kept.
        """
        super().__init__(
            rig.nsim,
            capacity,
            rate=protocol.sample_rate,
            window=protocol.window,
            tail=protocol.tail,
        )
        self._rig, self._sampler = rig, Sampler(rig, protocol, steps)
        self.step_vibration = np.zeros(rig.nsim)
        """(N,) root mean square of the vibration in the last step [m]."""
        self.step_left = np.zeros((rig.nsim, capacity, 2))
        """(N, G, 2) error left at the goals whose time was over in the last step, else 0 [m,
        rad]."""
        self.trace = [PathTrace() for _ in range(rig.nsim)] if record else None

    def start(self, ids: Index, goals: Index) -> None:
        """Begin anew with arms ``ids``, which have just begun to follow ``goals`` (M,) goals."""
        super().start(ids, goals)
        self._sampler.start(ids)
        self.step_vibration[ids] = self.step_left[ids] = 0.0
        if self.trace is not None:
            for i in ids:
                self.trace[i] = PathTrace()

    def advance(self) -> None:
        """Let all arms follow for one environment step."""
        self._samples = s = self._sampler.advance()
        sequencer, before = self._rig.sequencer, np.isfinite(self.settling[..., :1])
        self.feed(s.error, s.mean_square, sequencer.accepted_at, sequencer.reached_at)
        left = self.left
        self.step_left = np.where(np.isfinite(left) & ~before, left, 0.0)
        self.step_vibration = np.sqrt(s.mean_square.mean(axis=-1).sum(axis=-1))

    def mean_left(self, ids: Index) -> Array:
        """Return (M, 2) error left at the goals of arms ``ids``, mean over goals; NaN while one of
        them is not over [m, rad]."""
        mine = np.arange(self.settling.shape[1]) < self._goals[ids, None]
        left = np.where(mine[..., None], self.left[ids], 0.0).sum(axis=1)
        return left / self._goals[ids, None]

    def keep(self, ids: Index, amplitude: Array) -> None:
        """Add the last step of arms ``ids`` to their traces; ``amplitude`` (N, n) [N·m]."""
        assert self.trace is not None
        samples, size = self._samples, self._sampler.size
        for i in ids:
            trace = self.trace[i]
            trace.time.append((self.count[i] - size + np.arange(size)) / self._rate)
            trace.error.append(samples.error[i])
            trace.position.append(samples.actual[i, :, :3])
            trace.amplitude.append(amplitude[i : i + 1].copy())
