"""N simulations of the SJE environment. One episode is one ramp of one configuration."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.batch_core import (
    Array,
    BatchCore,
    Index,
    Outcome,
    ScatterKey,
    check_steps,
    read_friction,
    weights_of,
)
from stiction_envs.envs.layout import largest_stiction, observed_action, pack
from stiction_envs.envs.oscillation import Oscillation
from stiction_envs.envs.settings import sje_settings
from stiction_envs.envs.sje_base import base_torques
from stiction_envs.envs.sje_layout import GROUPS, check_sje_options
from stiction_envs.envs.trace import RampTrace
from stiction_envs.experiments.rig import count_blocks
from stiction_envs.experiments.settings import experiment_settings
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, configurations
from stiction_envs.experiments.sje.rig import APPROACH, BLOCK, RAMP
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import load_arm

TERMS = ("breakaway", "torque", "power", "torque_rate", "shaking")
"""Terms of the reward, in the order in which they are summed."""
BLOCK_S = BLOCK * CONTROL_DT
"""The control interval is a multiple of this [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Step(Outcome):
    """What one step of M simulations gave; arrays (M,)."""

    torque: Array
    """Commanded torque of the tested joint, dither excluded [N·m]."""
    displacement: Array
    """Angle of the tested joint since its ramp started [rad]."""
    time: Array
    """Time since the ramp started [s]."""
    vibration: Array
    """Oscillation of the joints in this step, before breakaway, root mean square [rad]."""
    shaking: Array
    """The same since the ramp started [rad]."""
    tau_sje: Array
    """Torque at the threshold [N·m]; NaN while not terminated."""
    tau_base: Array
    """[N·m]."""
    reduction: Array
    """1 − |τ_SJE| / |τ_base|; NaN while not terminated [-]."""


class SJECore(BatchCore):
    """N simulations of the SJE environment."""

    terms = TERMS
    each = ("torque", "displacement", "time", "vibration")
    final = ("shaking", "tau_sje", "tau_base", "reduction")
    # one after the other runs a whole block: only the block's arrays have to fit
    arms_per_thread = 256

    def __init__(
        self,
        num_envs: int,
        *,
        robot: str | Path = "panda",
        payload: Sequence[float] | None = None,
        tilt: Sequence[float] = (0.0, 0.0),
        chain: Sequence[str] | None = None,
        scatter: bool = True,
        friction: str | Path | FrictionParameters | None = None,
        control_interval_s: float = 0.1,
        power_weight: float | None = None,
        torque_rate_weight: float | None = None,
        shaking_weight: float | None = None,
        max_episode_steps: int = 1000,
        fixed_options: Mapping[str, Any] | None = None,
        randomise: Mapping[str, float] | None = None,
        friction_factor: float = 1.0,
        nthread: int = 0,
        record: bool = False,
    ) -> None:
        """Make them; `SJEEnv` explains the arguments. ``record`` keeps traces to draw."""
        arm = load_arm(robot, payload=payload, tilt=tilt, chain=chain)
        check_steps(max_episode_steps)
        reward = sje_settings().reward
        weights = weights_of(
            reward,
            power_weight=power_weight,
            torque_rate_weight=torque_rate_weight,
            shaking_weight=shaking_weight,
        )
        self.blocks = count_blocks("control_interval_s", control_interval_s, BLOCK_S)
        self.experiment = e = SingleJointExperiment(
            arm, friction=read_friction(friction, arm.n), scatter=scatter, nthread=nthread
        )
        super().__init__(
            num_envs,
            e,
            poses=e.poses,
            groups=GROUPS,
            interval=self.blocks * BLOCK_S,
            max_episode_steps=max_episode_steps,
            power_weight=weights["power_weight"],
            torque_rate_weight=weights["torque_rate_weight"],
            fixed_options=fixed_options,
            randomise=randomise,
            friction_factor=friction_factor,
        )
        self.rig = e.rig(num_envs, dither_all=True)
        self.shaking_weight = weights["shaking_weight"]
        self.oscillation = Oscillation(
            num_envs,
            self.n,
            corner=reward.shaking_corner,
            far=experiment_settings().oscillation.share * e.protocol.threshold,
        )
        self.rig.watch = self.oscillation.add
        self.stiction = largest_stiction(e.sticking.parameters, e.poses)
        self.speed_unit = e.protocol.threshold
        self.configuration: list[Configuration] = [Configuration(1, "load", "+")] * num_envs
        self.tau_base = np.ones(num_envs)
        self._level = np.zeros(num_envs)
        self.trace = [RampTrace() for _ in range(num_envs)] if record else None

    # ---- episodes ----------------------------------------------------------------------------

    def _check_options(self, options: Mapping[str, Any] | None) -> dict[str, Any]:
        return check_sje_options(options, self.n)

    def _draw(
        self, rng: np.random.Generator, options: Mapping[str, Any]
    ) -> tuple[Configuration, ScatterKey]:
        drawn = configurations(self.n)[int(rng.integers(4 * self.n))]
        key = tuple(int(k) for k in rng.integers(2**32, size=2))
        return dataclasses.replace(drawn, **options), key

    def _cases(self, options: Mapping[str, Any]) -> set[Configuration]:
        return {
            c
            for c in configurations(self.n)
            if all(getattr(c, name) == value for name, value in options.items())
        }

    def _undithered(self, cases: Sequence[Configuration]) -> Mapping[Configuration, float]:
        return base_torques(self.experiment, cases)

    def _begin(
        self,
        ids: Index,
        cases: Sequence[Configuration],
        keys: Sequence[ScatterKey],
        base: Sequence[float],
    ) -> None:
        for i, c, tau in zip(ids, cases, base, strict=True):
            self.configuration[i], self.tau_base[i] = c, tau
        rig = self.rig
        rig.place(ids, cases)
        rig.approach(ids, keys)
        rig.set_dither(ids, amplitude=0.0, frequency=0.0)
        # arms come to rest at different times; no ramp may start before the first action
        while len(moving := ids[rig.stage[ids] == APPROACH]):
            rig.advance(moving)
        self._level[ids] = 0.0
        self.oscillation.start(ids, rig.plant.position[ids], rig.joint[ids])
        if self.trace is not None:
            for i in ids:
                self.trace[i].clear()

    def _advance(self, ids: Index) -> None:
        busy = ids
        self.oscillation.begin_step(ids)
        for _ in range(self.blocks):
            ended = self.rig.advance(busy)
            if self.trace is not None:
                self._record(busy)
            if len(ended):
                busy = np.setdiff1d(busy, ended)
            if not len(busy):
                break

    def _outcome(self, ids: Index) -> Step:
        rig = self.rig
        tau, base = rig.tau[ids].copy(), np.abs(self.tau_base[ids])
        running = rig.stage[ids] == RAMP
        terminated = ~running & np.isfinite(tau)
        truncated = ~terminated & (~running | (self.steps[ids] >= self.max_episode_steps))
        torque = np.where(terminated, tau, self.torque(ids))
        level = np.abs(torque)
        square = self.oscillation.step_mean_square(ids)
        share = self.interval * rig.protocol.ramp_rate / base
        terms = {
            "breakaway": terminated.astype(float),
            "torque": -(level - self._level[ids]) / base,
            **self._penalties(ids, share),
            "shaking": -self.shaking_weight * share * square / rig.protocol.threshold**2,
        }
        self._level[ids] = level
        self.alive[ids] = ~(terminated | truncated)
        tau[~terminated] = np.nan
        return Step(
            reward=self._sum(terms),
            terms=terms,
            terminated=terminated,
            truncated=truncated,
            torque=torque,
            displacement=rig.displacement()[ids],
            time=self._time(ids),
            vibration=np.sqrt(square),
            shaking=self.oscillation.episode_rms(ids),
            tau_sje=tau,
            tau_base=self.tau_base[ids].copy(),
            reduction=1.0 - np.abs(tau) / base,
        )

    # ---- what is seen ------------------------------------------------------------------------

    def torque(self, ids: Index) -> Array:
        """Return (M,) commanded torque of the tested joints, dither excluded, now [N·m]."""
        last = np.maximum(self.rig.step[ids] - 1, 0)
        return self.rig.ramp_torque(ids, last[:, None])[:, 0]

    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of simulations ``ids``: a fresh array."""
        rig, rows = self.rig, np.arange(len(ids))
        threshold = rig.protocol.threshold
        base = np.abs(self.tau_base[ids])
        torque, asked = self.torque(ids), rig.holding_torque[ids]
        asked[rows, rig.joint[ids]] = torque
        tested = np.zeros((len(ids), self.n))
        tested[rows, rig.joint[ids]] = 1.0
        amplitude, frequency = observed_action(self.action[ids], self._low, self._high)
        values = {
            "displacement": (rig.plant.position[ids] - rig.pose[ids]) / threshold,
            "velocity": rig.plant.velocity[ids] / threshold,
            "progress": rig.sign[ids] * rig.displacement()[ids] / threshold,
            "torque": asked / self.stiction,
            "ramp": torque / base,
            "elapsed": rig.sign[ids] * (torque - rig.start_torque[ids]) / base,
            "tested": tested,
            "load": np.array([float(self.configuration[i].load == "load") for i in ids]),
            "direction": rig.sign[ids],
            "amplitude": amplitude,
            "frequency": frequency,
        }
        space = self.observation_space
        return pack(GROUPS, values, len(ids), space.low, space.high)

    def describe(self, ids: Index) -> dict[str, NDArray[Any]]:
        """Return joint (from 1), load and direction of the episodes of ``ids``."""
        rows = [self.configuration[i] for i in ids]
        return {
            "joint": np.array([c.joint for c in rows]),
            "load": np.array([c.load for c in rows], dtype=object),
            "direction": np.array([c.direction for c in rows], dtype=object),
        }

    def _record(self, ids: Index) -> None:
        assert self.trace is not None
        torque, moved = self.torque(ids), self.rig.displacement()[ids]
        for row, i in enumerate(ids):
            k = self.rig.joint[i]
            self.trace[i].add(
                time=float(self.rig.step[i] * CONTROL_DT),
                torque=float(torque[row]),
                amplitude=float(self.action[i, k]),
                frequency=float(self.action[i, self.n + k]),
                displacement=float(moved[row]),
            )
