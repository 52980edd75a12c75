"""Agents without learning, as baselines for policies, with Stable-Baselines3's `predict`.

    from stiction_envs.envs.agents import GatedTable

    env = gym.make_vec("stiction_envs:PandaGTE-v0", num_envs=8)
    agent = GatedTable(env)
    actions, _ = agent.predict(observations)

Observations are (observations,) or a batch (M, observations), actions (2n,) or (M, 2n) in the units
of the environment: amplitudes [N·m], then frequencies [Hz]. Actions depend on the observation only,
so that they are the same bits in any batch.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array, Bools
from stiction_envs.envs.evaluation import AnyEnv, State
from stiction_envs.envs.gym_env import ArmEnv, ArmVectorEnv, Observation
from stiction_envs.errors import StictionError
from stiction_envs.experiments.episodes import Episodes
from stiction_envs.experiments.gte.rows import thesis_final_dither
from stiction_envs.measured.tables import AmplitudeRow, read_amplitudes
from stiction_envs.measured.thesis_tables import thesis_robots
from stiction_envs.method_settings import Positive, checked

Table = str | Path | Sequence[AmplitudeRow]


USUAL_AMPLITUDE = 1.5
"""Amplitude of an unknown arm's table, over the stiction [-]; assumed: Table 4.9 of the thesis has
1.2 to 2.5 on the Panda's joints."""
USUAL_FREQUENCY = 30.0
"""Frequency of the same table [Hz]; assumed: Table 4.9 has 15 to 50."""
GATE_SPEED = 0.05
"""v_gate, at which dither fades where a table has no gate [rad/s]; assumed: a quarter of the speed
along the paths."""


class Agent(ABC):
    """Reads the spaces of its environment, and the places of speeds in observations."""

    def __init__(self, env: AnyEnv) -> None:
        """Read an environment of this package, single or native batch, wrapped or not.

        Raises:
            StictionError: another environment.
        """
        base = env.unwrapped
        if not isinstance(base, ArmEnv | ArmVectorEnv):
            raise StictionError(
                f"{type(self).__name__}: {type(base).__name__}: expected an environment of "
                "stiction_envs"
            )
        self.core, names = base.core, list(base.observation_names)
        self.n = n = int(self.core.n)
        space = self.core.action_space
        self.low, self.high = space.low.astype(float), space.high.astype(float)
        self._speed = np.array([names.index(f"velocity_{j}") for j in range(1, n + 1)])

    def predict(
        self,
        observation: Observation,
        state: State | None = None,
        episode_start: Bools | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], State | None]:
        """Return the actions for observations (observations,) or (M, observations).

        The other arguments are Stable-Baselines3's; agents have no state, and return the given one.
        """
        rows = np.atleast_2d(observation)
        actions = np.clip(self._act(rows), self.low, self.high).astype(np.float32)
        # float32 may lie above the bound that it was rounded from
        actions = np.clip(actions, self.low.astype(np.float32), self.high.astype(np.float32))
        return (actions[0] if np.ndim(observation) == 1 else actions), state

    @abstractmethod
    def _act(self, observation: Observation) -> Array:
        """Return actions (M, 2n) for observations (M, observations)."""


class NoDither(Agent):
    """Dithers no joint."""

    def _act(self, observation: Observation) -> Array:
        return np.tile(self.low, (len(observation), 1))


class RandomDither(Agent):
    """Amplitudes and frequencies drawn uniformly within their bounds, seeded by the observation."""

    def _act(self, observation: Observation) -> Array:
        share = np.empty((len(observation), 2 * self.n))
        for out, row in zip(share, np.ascontiguousarray(observation, np.float32), strict=True):
            seed = [0, *np.frombuffer(row.tobytes(), np.uint32)]
            out[:] = np.random.default_rng(seed).uniform(size=2 * self.n)
        return self.low + share * (self.high - self.low)


class GatedTable(Agent):
    """A table whose amplitudes fade with joint speed: A exp(−(q̇/v_gate)²), as `Dither`'s.

    A controller reads the speed in every cycle, an agent once per step.
    """

    def __init__(
        self, env: AnyEnv, table: Table | None = None, *, speed: float = GATE_SPEED
    ) -> None:
        """Read the environment, and a table: a file, or rows; None for `usual_table`.

        ``speed`` is v_gate of joints without a gate in the table [rad/s], above 0; inf for no gate.

        Raises:
            StictionError: another environment, or a table that cannot be read or is outside the
                bounds of the action.
        """
        super().__init__(env)
        checked(speed, Positive, "gate speed [rad/s]")
        where = table if isinstance(table, (str, Path)) else "table"
        if table is None:
            rows: Sequence[AmplitudeRow] = usual_table(self.core)
        elif isinstance(table, (str, Path)):
            rows = read_amplitudes(Path(table), n_joints=self.n)
        else:
            rows = table
        waveform = self.core.waveform
        self.amplitude, self.frequency = np.zeros(self.n), self.low[self.n :].copy()
        self.gate = np.full(self.n, speed)
        for row in rows:
            if not 1 <= row.joint <= self.n:
                raise StictionError(f"{where}: joint {row.joint}: expected 1 to {self.n}")
            if row.waveform != waveform or row.offset_nm != 0:
                raise StictionError(
                    f"{where}: joint {row.joint}: {row.waveform} with offset {row.offset_nm:g} "
                    f"N·m: expected {waveform} without offset, as in the environment"
                )
            if row.amplitude_nm == 0:
                continue
            j = row.joint - 1
            drive = ((row.amplitude_nm, j, "N·m"), (row.frequency_hz, j + self.n, "Hz"))
            for value, k, unit in drive:
                if not self.low[k] <= value <= self.high[k] * (1 + 1e-6):
                    raise StictionError(
                        f"{where}: joint {row.joint}: {value:g} {unit}: expected "
                        f"{self.low[k]:g} to {self.high[k]:g}, as in the environment's action"
                    )
            self.amplitude[j], self.frequency[j] = row.amplitude_nm, row.frequency_hz
            self.gate[j] = row.gate_rad_s or speed

    def _act(self, observation: Observation) -> Array:
        speed = observation[:, self._speed].astype(float) * self.core.speed_unit
        amplitude = np.exp(-((speed / self.gate) ** 2)) * self.amplitude
        return np.concatenate([amplitude, np.tile(self.frequency, (len(amplitude), 1))], axis=1)


AGENTS: dict[str, type[Agent]] = {"none": NoDither, "random": RandomDither, "gated": GatedTable}
"""Agents by name; each needs no argument but the environment."""


def usual_table(core: Episodes) -> tuple[AmplitudeRow, ...]:
    """Return Table 4.9 of the thesis for its Panda; other arms get its proportions (assumed)."""
    if core.arm.registered_name in thesis_robots("4.9"):
        return thesis_final_dither()
    return proportional_table(core.stiction, core.action_space.high[: core.n].astype(float))


def proportional_table(stiction: Array, most: Array) -> tuple[AmplitudeRow, ...]:
    """Return dither in proportion to the stiction (n,) [N·m], up to ``most`` (n,) [N·m]."""
    amplitude = np.minimum(most, USUAL_AMPLITUDE * stiction)
    return tuple(AmplitudeRow(j, USUAL_FREQUENCY, a) for j, a in enumerate(amplitude.tolist(), 1))
