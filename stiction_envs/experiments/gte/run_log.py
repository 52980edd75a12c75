"""Writes down what a rig does until every arm has come to the end of its path."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.experiments.gte.protocol import FLAGS, Case, GTEProtocol, Run
from stiction_envs.experiments.gte.rig import GTERig
from stiction_envs.experiments.gte.sampling import Sampler, Samples
from stiction_envs.plant import CONTROL_DT

Array = NDArray[np.float64]
_SAMPLED = ("actual", "reference", "mean_square", "power", "rate", "flags")


class RunLog(Sampler):
    """All samples of a rig's arms, with what dither and controller did to the joints."""

    def __init__(self, rig: GTERig, protocol: GTEProtocol, steps: int) -> None:
        """Log blocks of ``steps`` control steps; the arms have just begun to follow."""
        super().__init__(rig, protocol, steps)
        self._protocol, self._sequencer = protocol, rig.sequencer
        self._speed, self._motor = rig.plant.batch.bind("qvel"), rig.plant.sticking.motor
        self._previous = rig.applied.copy()
        self._blocks: dict[str, list[NDArray[Any]]] = {name: [] for name in _SAMPLED}
        self._fresh()

    def _fresh(self) -> None:
        """Begin a block."""
        nsim, n = self._rig.nsim, self._rig.n
        self._power = np.zeros((nsim, self.size))
        self._rate = np.zeros((nsim, self.size, n))
        self._flags = np.zeros((nsim, self.size, len(FLAGS)), dtype=bool)

    @property
    def time(self) -> float:
        """Simulated since the first goal [s]."""
        return len(self._blocks["actual"]) * self.size / self._protocol.sample_rate

    def advance(self) -> Samples:
        """Let all arms follow for one block, and keep its samples."""
        samples = super().advance()
        new = {
            "actual": samples.actual,
            "reference": samples.reference,
            "mean_square": samples.mean_square.transpose(0, 2, 1),
            "power": self._power / self.stride,
            "rate": self._rate,
            "flags": self._flags,
        }
        for name, values in new.items():
            self._blocks[name].append(values)
        self._fresh()
        return samples

    def _watch(self) -> None:
        rig, s = self._rig, self._tick // self.stride
        super()._watch()
        self._power[:, s] += np.abs(rig.dither_torque * self._speed[:, self._motor]).sum(axis=1)
        rate, change = self._rate[:, s], np.abs(rig.applied - self._previous)
        np.maximum(rate, change / CONTROL_DT, out=rate)
        self._previous[:] = rig.applied
        flags = rig.controller.flags
        for k, name in enumerate(FLAGS):
            self._flags[:, s, k] |= getattr(flags, name)

    def end(self, horizon: Array) -> Array:
        """Return (N,) when a simulation's record may end, ∞ where that is not known yet [s].

        Args:
            horizon: (N,) when each is given up [s].
        """
        reached, finished = self._sequencer.reached_at, self._sequencer.finished
        last = np.nanmax(reached, axis=1, where=np.isfinite(reached), initial=0)
        known = finished | (self.time >= horizon)
        last = np.where(finished, np.minimum(last, horizon), horizon)
        return np.where(known, last + self._protocol.tail, np.inf)

    def run(self, case: Case, mine: NDArray[np.bool_], goals: int, horizon: Array) -> Run:
        """Return the run of simulations ``mine``: cut at its own end, whatever else was run."""
        rate, given_up = self._protocol.sample_rate, horizon[mine][:, None]
        count = int(np.ceil(float(self.end(horizon)[mine].max()) * rate - 1e-6))
        accepted = self._sequencer.accepted_at[mine, :goals]
        reached = self._sequencer.reached_at[mine, :goals]

        def samples(name: str) -> NDArray[Any]:
            return np.concatenate([x[mine] for x in self._blocks[name]], axis=1)[:, :count]

        flags = np.any(samples("flags"), axis=1)
        return Run(
            case=case,
            time=np.arange(count) / rate,
            reference=samples("reference"),
            actual=samples("actual"),
            accepted=np.where(accepted > given_up, np.nan, accepted),
            reached=np.where(reached > given_up, np.nan, reached),
            mean_square=samples("mean_square"),
            dither_power=samples("power"),
            torque_rate=samples("rate").max(axis=1),
            flags={name: flags[:, k] for k, name in enumerate(FLAGS)},
        )
