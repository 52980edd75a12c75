"""The SJE environment for N slots: what the single and the vector environment share.

One episode is one ramp of one configuration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stiction_envs.envs.batch_core import (
    Array,
    Index,
    Outcome,
    Slots,
    check_arguments,
    count_blocks,
)
from stiction_envs.envs.sje_base import base_torques
from stiction_envs.envs.sje_layout import GROUPS, action_bounds, check_options
from stiction_envs.envs.trace import Trace
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import Configuration, configurations
from stiction_envs.experiments.sje.rig import APPROACH, BLOCK, RAMP
from stiction_envs.friction.parameters import FrictionParameters, load_friction
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import load_arm

TERMS = ("breakaway", "torque", "power", "torque_rate")
"""Terms of the reward, in the order in which they are summed."""
BLOCK_S = BLOCK * CONTROL_DT
"""The control interval is a multiple of this [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Step(Outcome):
    """What one step of M slots gave; arrays (M,)."""

    torque: Array
    """Commanded torque of the tested joint, dither excluded [N·m]."""
    displacement: Array
    """Angle of the tested joint since its ramp started [rad]."""
    time: Array
    """Time since the ramp started [s]."""
    tau_sje: Array
    """Torque at the threshold [N·m]; NaN while not terminated."""
    tau_base: Array
    """[N·m]."""
    reduction: Array
    """1 − |τ_SJE| / |τ_base|; NaN while not terminated [-]."""


class Core(Slots):
    """N slots of the SJE environment."""

    terms = TERMS
    each = ("torque", "displacement", "time")
    final = ("tau_sje", "tau_base", "reduction")

    def __init__(
        self,
        num_envs: int,
        *,
        robot: str | Path = "panda",
        payload: Sequence[float] | None = None,
        tilt: Sequence[float] = (0.0, 0.0),
        scatter: bool = True,
        friction: str | Path | FrictionParameters | None = None,
        control_interval_s: float = 0.1,
        power_weight: float = 0.01,
        torque_rate_weight: float = 0.01,
        max_episode_steps: int = 1000,
        fixed_options: Mapping[str, Any] | None = None,
        nthread: int = 0,
        record: bool = False,
    ) -> None:
        """Make the slots; `SJEEnv` explains the arguments. ``record`` keeps traces to draw."""
        arm = load_arm(robot, payload=payload, tilt=tilt)
        if isinstance(friction, (str, Path)):
            friction = load_friction(Path(friction), arm.n)
        check_arguments(
            max_episode_steps, power_weight=power_weight, torque_rate_weight=torque_rate_weight
        )
        self.blocks = count_blocks(control_interval_s, BLOCK_S)
        self.experiment = e = SingleJointExperiment.of(
            arm, friction=friction, scatter=scatter, nthread=nthread
        )
        low, high = action_bounds(e.sticking.parameters, e.poses, e.interface)
        super().__init__(
            num_envs,
            arm,
            groups=GROUPS,
            low=low,
            high=high,
            interval=self.blocks * BLOCK_S,
            max_episode_steps=max_episode_steps,
        )
        self.power_weight, self.torque_rate_weight = power_weight, torque_rate_weight
        self.fixed_options = check_options(fixed_options, arm.n)
        self.rig = e.rig(num_envs, dither_all=True)
        self.configuration: list[Configuration] = [Configuration(1, "load", "+")] * num_envs
        self.tau_base = np.ones(num_envs)
        self._level = np.zeros(num_envs)
        self.trace: list[Trace] | None = [Trace() for _ in range(num_envs)] if record else None

    # ---- reset -------------------------------------------------------------------------------

    def reset(
        self,
        ids: Index,
        rngs: Sequence[np.random.Generator],
        options: Sequence[Mapping[str, Any] | None],
    ) -> None:
        """Start an episode in slots ``ids``, each drawn from its own generator.

        A generator gives the same number of draws whatever the options say.

        Raises:
            StictionError: an option that does not exist.
        """
        checked = [{**self.fixed_options, **check_options(o, self.n)} for o in options]
        drawn = [self._draw(rng, o) for rng, o in zip(rngs, checked, strict=True)]
        chosen, keys = [c for c, _ in drawn], [k for _, k in drawn]
        wanted = set(chosen)
        if any(set(o) != {"joint", "load", "direction"} for o in checked):
            # further episodes will draw as well: one batch for all is the fastest
            wanted |= {c for c in configurations(self.n) if _fits(c, self.fixed_options)}
        base = base_torques(self.experiment, sorted(wanted))
        for i, c in zip(ids, chosen, strict=True):
            self.configuration[i], self.tau_base[i] = c, base[c]
        rig = self.rig
        rig.place(ids, chosen)
        rig.approach(ids, keys)
        rig.set_dither(ids, amplitude=0.0, frequency=0.0)
        self.action[ids] = self._low
        # slots come to rest at different times; no ramp may start before the first action
        while len(moving := ids[rig.stage[ids] == APPROACH]):
            rig.advance(moving)
        self._level[ids], self.steps[ids], self.alive[ids] = 0.0, 0, True
        if self.trace is not None:
            for i in ids:
                self.trace[i].clear()

    def _draw(
        self, rng: np.random.Generator, options: Mapping[str, Any]
    ) -> tuple[Configuration, tuple[int, ...]]:
        drawn = configurations(self.n)[int(rng.integers(4 * self.n))]
        key = tuple(int(k) for k in rng.integers(2**32, size=2))
        return Configuration(
            options.get("joint", drawn.joint),
            options.get("load", drawn.load),
            options.get("direction", drawn.direction),
        ), key

    # ---- step --------------------------------------------------------------------------------

    def step(self, ids: Index, action: Any) -> Step:
        """Dither slots ``ids`` with ``action`` (M, 2n) [N·m, Hz] for one control interval.

        Raises:
            StictionError: an action outside the space, or a slot whose episode is over.
        """
        self._need_alive(ids)
        action = self._check_action(action, len(ids))
        rig = self.rig
        self.action[ids] = action
        rig.retune(self.action[:, : self.n], self.action[:, self.n :])
        busy = ids
        for _ in range(self.blocks):
            ended = rig.advance(busy)
            if self.trace is not None:
                self._record(busy)
            if len(ended):
                busy = np.setdiff1d(busy, ended)
            if not len(busy):
                break
        self.steps[ids] += 1
        return self._outcome(ids, action)

    def _outcome(self, ids: Index, action: Array) -> Step:
        rig = self.rig
        tau, base = rig.tau[ids].copy(), np.abs(self.tau_base[ids])
        running = rig.stage[ids] == RAMP
        terminated = ~running & np.isfinite(tau)
        truncated = ~terminated & (~running | (self.steps[ids] >= self.max_episode_steps))
        torque = np.where(terminated, tau, self.torque(ids))
        level = np.abs(torque)
        terms = {
            "breakaway": terminated.astype(float),
            "torque": -(level - self._level[ids]) / base,
            **self._penalties(action, base),
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
            time=rig.step[ids].astype(float) * CONTROL_DT,
            tau_sje=tau,
            tau_base=self.tau_base[ids].copy(),
            reduction=1.0 - np.abs(tau) / base,
        )

    def _penalties(self, action: Array, base: Array) -> dict[str, Array]:
        share = self.interval * self.experiment.protocol.ramp_rate / base
        power, rate = self._loads(action)
        return {
            "power": -self.power_weight * share * power,
            "torque_rate": -self.torque_rate_weight * share * rate,
        }

    # ---- what is seen ------------------------------------------------------------------------

    def torque(self, ids: Index) -> Array:
        """Return (M,) commanded torque of the tested joints, dither excluded, now [N·m]."""
        last = np.maximum(self.rig.step[ids] - 1, 0)
        return self.rig.ramp_torque(ids, last[:, None])[:, 0]

    def observe(self, ids: Index) -> NDArray[np.float32]:
        """Return the observations (M, observations) of slots ``ids``: a fresh array."""
        rig, rows = self.rig, np.arange(len(ids))
        threshold = rig.protocol.threshold
        base = np.abs(self.tau_base[ids])
        torque = self.torque(ids)
        tested = np.zeros((len(ids), self.n))
        tested[rows, rig.joint[ids]] = 1.0
        amplitude, frequency = self._scaled(ids)
        values = {
            "displacement": (rig.plant.position[ids] - rig.pose[ids]) / threshold,
            "velocity": rig.plant.velocity[ids] / threshold,
            "progress": rig.sign[ids] * rig.displacement()[ids] / threshold,
            "torque": torque / base,
            "elapsed": rig.sign[ids] * (torque - rig.start_torque[ids]) / base,
            "tested": tested,
            "load": np.array([float(self.configuration[i].load == "load") for i in ids]),
            "direction": rig.sign[ids],
            "amplitude": amplitude,
            "frequency": frequency,
        }
        return self._pack(values, len(ids))

    def describe(self, ids: Index) -> dict[str, NDArray[Any]]:
        """Return joint (from 1), load and direction of the episodes of slots ``ids``."""
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


def _fits(configuration: Configuration, options: Mapping[str, Any]) -> bool:
    return all(getattr(configuration, k) == v for k, v in options.items())
