"""Episodes of the Single Joint Experiment: one is one ramp of one configuration."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from stiction_envs.errors import unknown
from stiction_envs.experiments.episodes import (
    Arguments,
    Array,
    Episodes,
    Index,
    Options,
    Outcome,
    ScatterKey,
)
from stiction_envs.experiments.observation import (
    DITHER,
    TORQUE,
    Checked,
    Elements,
    largest_stiction,
    named_options,
)
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.experiments.sje.protocol import (
    Configuration,
    configurations,
    sje_reward_settings,
)
from stiction_envs.experiments.sje.rig import APPROACH, BLOCK, RAMP, STICKING, SJERig
from stiction_envs.experiments.sje.undithered import base_torques
from stiction_envs.filters import butterworth, filter_sections
from stiction_envs.friction.sticking import Friction
from stiction_envs.measured.tables import DIRECTIONS, LOADS
from stiction_envs.plant import CONTROL_DT
from stiction_envs.robots import Arm


class Oscillation:
    """Root mean square of the joints' angles above a corner frequency, step by step.

    Angles of all joints are added as a vector. A high-pass of fourth order (twice the Butterworth
    of second order) keeps out the joint that speeds up when it breaks away. Once the joint under
    test has moved by more than ``far`` from where its ramp found it, nothing counts any more.
    """

    def __init__(self, nsim: int, n: int, *, corner: float, far: float) -> None:
        """Prepare ``nsim`` arms of n joints; `start` each.

        At ``corner`` each of the two high-passes has the gain 1/√2 [Hz].
        """
        self._band = np.repeat(butterworth(2, corner, 1.0 / CONTROL_DT, high=True), 2, axis=0)
        self._far = far
        self._state = np.zeros((len(self._band), nsim, n, 2))
        self._rest = np.zeros((nsim, n))
        self._joint = np.zeros(nsim, dtype=np.int64)
        self._gone = np.zeros(nsim, dtype=bool)
        # sum of squares [rad²] and number of angles: of a step, and of all
        self._step, self._all = np.zeros((2, 2, nsim))

    def start(self, ids: Index, angle: Array, joint: Index) -> None:
        """Restart arms ``ids`` that rest at ``angle`` (M, n) [rad]; tested is ``joint``."""
        self._state[:, ids], self._rest[ids], self._joint[ids] = 0.0, angle, joint
        self._gone[ids] = False
        self._step[:, ids] = self._all[:, ids] = 0.0

    def begin_step(self, ids: Index) -> None:
        """Begin an environment step of arms ``ids``."""
        self._step[:, ids] = 0.0

    def add(self, ids: Index, angle: Array) -> None:
        """Take the next angles (M, K, n) of arms ``ids``, one per control step [rad]."""
        moved = np.ascontiguousarray((angle - self._rest[ids][:, None]).transpose(0, 2, 1))
        mine = np.abs(moved[np.arange(len(ids)), self._joint[ids]])
        state = np.ascontiguousarray(self._state[:, ids])
        filter_sections(self._band, moved, state)
        self._state[:, ids] = state
        gone = np.logical_or.accumulate(mine >= self._far, axis=1) | self._gone[ids][:, None]
        self._gone[ids] = gone[:, -1]
        squares = np.where(gone, 0.0, (moved**2).sum(axis=1)).sum(axis=1)
        for total in (self._step, self._all):
            total[:, ids] += squares, (~gone).sum(axis=1)

    def step_mean_square(self, ids: Index) -> Array:
        """Return (M,) mean square of the last step, 0 where nothing counted [rad²]."""
        squares, count = self._step[:, ids]
        return squares / np.maximum(count, 1.0)

    def episode_rms(self, ids: Index) -> Array:
        """Return (M,) root mean square since the start [rad]."""
        squares, count = self._all[:, ids]
        return np.sqrt(squares / np.maximum(count, 1.0))


OPTIONS = ("joint", "load", "direction")  # Names of the reset options
GROUPS = (
    Elements("displacement", -5.0, 5.0, "threshold", "link angle minus the pose", per_joint=True),
    Elements("velocity", -50.0, 50.0, "threshold/s", "link speed", per_joint=True),
    TORQUE,
    Elements("progress", -5.0, 5.0, "threshold", "angle since the ramp started, along the ramp"),
    Elements(
        "ramp", -10.0, 10.0, "τ_base", "commanded torque of the tested joint, dither excluded"
    ),
    Elements("elapsed", 0.0, 20.0, "τ_base", "torque by which the ramp has grown"),
    Elements("tested", 0.0, 1.0, "1", "1 for the tested joint, else 0", per_joint=True),
    Elements("load", 0.0, 1.0, "1", "1 in the load pose, 0 in the no-load pose"),
    Elements("direction", -1.0, 1.0, "1", "sign of the ramp"),
    *DITHER,
)
"""The observation, in order; bounds are assumed: wider than what occurs."""


class SJEEpisodes(Episodes[Configuration, float]):
    """N episodes of the Single Joint Experiment."""

    experiment: SingleJointExperiment
    rig: SJERig
    terms = ("breakaway", "torque", "power", "torque_rate", "shaking")
    groups = GROUPS
    # one after the other runs a whole block: only its arrays have to fit; 64 had 0.95 of the speed
    arms_per_batch = 256

    reward_settings = staticmethod(sje_reward_settings)

    def _experiment(
        self, a: Arguments, arm: Arm, friction: Friction | None
    ) -> SingleJointExperiment:
        return SingleJointExperiment(arm, friction=friction, scatter=a.scatter, threads=a.threads)

    @staticmethod
    def block_steps(experiment: SingleJointExperiment) -> int:
        """Return the control steps of which a control interval is a multiple."""
        return BLOCK

    def _make(self, a: Arguments) -> None:
        e, reward = self.experiment, self.reward_settings()
        self.rig = e.replace(threads=self._engine_threads).rig(self.num_envs)
        self.oscillation = Oscillation(
            self.num_envs, self.n, corner=reward.shaking_corner, far=STICKING * e.protocol.threshold
        )
        self.rig.watch = self.oscillation.add
        self.stiction = largest_stiction(e.sticking.parameters, e.poses)
        self.speed_unit = e.protocol.threshold
        self.configuration = [Configuration(1, "load", "+")] * self.num_envs
        self.tau_base = np.ones(self.num_envs)
        self._level = np.zeros(self.num_envs)

    def _check_options(self, options: Options | None) -> Checked:
        expected: dict[str, tuple[object, ...]] = {
            "joint": tuple(range(1, self.n + 1)),
            "load": LOADS,
            "direction": DIRECTIONS,
        }
        out: Checked = {}
        for name, value in named_options(options, OPTIONS).items():
            kinds = (int, np.integer) if name == "joint" else (str,)
            fits = isinstance(value, kinds) and not isinstance(value, bool)
            if not fits or value not in expected[name]:
                raise unknown(name, value, expected[name])
            out[name] = int(value) if name == "joint" else value
        return out

    def _draw(self, rng: np.random.Generator, options: Checked) -> tuple[Configuration, ScatterKey]:
        drawn = configurations(self.n)[int(rng.integers(4 * self.n))]
        key = tuple(int(k) for k in rng.integers(2**32, size=2))
        return dataclasses.replace(drawn, **options), key

    def _cases(self, options: Checked) -> set[Configuration]:
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
        rig.set_dither(ids, amplitude=0.0, frequency=0.0, waveform=self.waveform)
        # arms come to rest at different times; no ramp may start before the first action
        while len(moving := ids[rig.stage[ids] == APPROACH]):
            rig.advance(moving)
        self._level[ids] = 0.0
        self.oscillation.start(ids, rig.plant.position[ids], rig.joint[ids])

    def _advance(self, ids: Index) -> None:
        busy = ids
        self.oscillation.begin_step(ids)
        for _ in range(self.interval_steps // BLOCK):
            ended = self.rig.advance(busy)
            if len(ended):
                busy = np.setdiff1d(busy, ended)
            if not len(busy):
                break

    def _outcome(self, ids: Index) -> Outcome:
        rig = self.rig
        tau, base = rig.tau[ids], np.abs(self.tau_base[ids])
        running = rig.stage[ids] == RAMP
        terminated = ~running & np.isfinite(tau)
        truncated = ~terminated & (~running | (self.steps[ids] >= self.max_episode_steps))
        torque = np.where(terminated, tau, self.torque(ids))
        level = np.abs(torque)
        square = self.oscillation.step_mean_square(ids)
        share = self.interval * rig.protocol.ramp_rate / base
        shaking_weight = self.weights["shaking_weight"]
        terms = {
            "breakaway": terminated.astype(float),
            "torque": -(level - self._level[ids]) / base,
            **self._penalties(ids, share),
            "shaking": -shaking_weight * share * square / rig.protocol.threshold**2,
        }
        self._level[ids] = level
        return Outcome(
            terms=terms,
            terminated=terminated,
            truncated=truncated,
            measures={
                "torque": torque,
                "displacement": rig.displacement()[ids],
                "time": self._time(ids),
                "vibration": np.sqrt(square),
            },
        )

    def last_measures(self, ids: Index) -> dict[str, NDArray[np.generic]]:
        """Return shaking and torques of episodes that are over; NaN for a joint that is stuck."""
        tau, base = self.rig.tau[ids], self.tau_base[ids]
        return {
            "shaking": self.oscillation.episode_rms(ids),
            "tau_sje": tau,
            "tau_base": base,
            "reduction": 1.0 - np.abs(tau) / np.abs(base),
        }

    @staticmethod
    def columns(measures: Mapping[str, Array]) -> dict[str, float]:
        """Return the columns that an episode's last measures fill in a table of evaluations."""
        return {
            "reduction": float(measures["reduction"]),
            "tau_sje_nm": float(measures["tau_sje"]),
            "tau_base_nm": float(measures["tau_base"]),
            "oscillation_mrad": 1e3 * float(measures["shaking"]),
            "time_s": float(measures["time"]),
        }

    def torque(self, ids: Index) -> Array:
        """Return (M,) commanded torque of the tested joints, dither excluded, now [N·m]."""
        last = np.maximum(self.rig.step[ids] - 1, 0)
        return self.rig.ramp_torque(ids, last[:, None])[:, 0]

    def _observed(self, ids: Index) -> dict[str, Array]:
        rig, rows = self.rig, np.arange(len(ids))
        threshold = rig.protocol.threshold
        base = np.abs(self.tau_base[ids])
        torque, asked = self.torque(ids), rig.holding_torque[ids]
        asked[rows, rig.joint[ids]] = torque
        tested = np.zeros((len(ids), self.n))
        tested[rows, rig.joint[ids]] = 1.0
        return {
            "displacement": (rig.seen_position[ids] - rig.pose[ids]) / threshold,
            "velocity": rig.seen_velocity[ids] / threshold,
            "progress": rig.sign[ids] * rig.displacement()[ids] / threshold,
            "torque": asked / self.stiction,
            "ramp": torque / base,
            "elapsed": rig.sign[ids] * (torque - rig.start_torque[ids]) / base,
            "tested": tested,
            "load": np.array([float(self.configuration[i].load == "load") for i in ids]),
            "direction": rig.sign[ids],
        }

    def describe(self, ids: Index) -> dict[str, NDArray[np.generic]]:
        """Return joint (from 1), load and direction of the episodes of ``ids``."""
        rows = [self.configuration[i] for i in ids]
        return {
            "joint": np.array([c.joint for c in rows]),
            "load": np.array([c.load for c in rows], dtype=object),
            "direction": np.array([c.direction for c in rows], dtype=object),
        }
