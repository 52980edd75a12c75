"""Parts of every experiment: its definition, and its rig of N arms on one plant.

    protocol (TOML) -> Experiment -> Rig -> measurements -> rows, report
                                  -> Episodes (actions, observation, reward) -> Env, VectorEnv

An experiment is one folder: its `Experiment`, its `Rig` and its `Episodes`, and one line of
`envs.registration`, by which its environments are found.
"""

import copy
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.arrays import Array, Index
from stiction_envs.control.sensing import Senses, Sensing, SensingLike, load_sensing, seeds_of
from stiction_envs.control.torque_path import TorqueInterface, TorquePath
from stiction_envs.dither.dither import Dither
from stiction_envs.dither.waveforms import DEFAULT_WAVEFORM
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.holding_servos import Approach, Servos
from stiction_envs.friction.model import StickingModel
from stiction_envs.friction.parameters import FrictionParameters
from stiction_envs.friction.sticking import model_sha256
from stiction_envs.measured.tables import AmplitudeRow
from stiction_envs.plant import CONTROL_DT, Plant


@dataclass(frozen=True, init=False, repr=False)
class Experiment:
    """One arm, its friction, its torque interface and a protocol: all that defines a result."""

    sticking: StickingModel
    interface: TorqueInterface
    sensing: Sensing
    """Senses of the controller."""
    scatter: bool
    seed: int
    threads: int

    def __init__(
        self,
        sticking: StickingModel,
        *,
        interface: TorqueInterface | None = None,
        sensing: SensingLike = "ideal",
        scatter: bool = False,
        seed: int = 0,
        threads: int = 0,
    ) -> None:
        """Set the experiment up.

        Args:
            sticking: the model.
            interface: path of commanded torques; None for the robot's.
            sensing: senses of its controller; see `load_sensing`.
            scatter: whether iterations differ by pose, friction and dither.
            seed: of that scatter.
            threads: threads, 0 for all processors.
        """
        if interface is None:
            interface = TorqueInterface.of(sticking.arm)
        found = load_sensing(sticking.arm, sensing)
        vars(self).update(sticking=sticking, interface=interface, sensing=found)
        vars(self).update(scatter=scatter, seed=seed, threads=threads)

    def replace(self, **changes: object) -> Self:
        """Return a copy with some fields changed; the other fields stay as they are."""
        names = [f.name for f in dataclasses.fields(self)]
        for name in changes:
            if name not in names:
                raise TypeError(f"{type(self).__name__} has no field {name!r}")
        out = copy.copy(self)
        vars(out).update(changes)
        return out

    @property
    def record(self) -> dict[str, object]:
        """Entries of a provenance for all but protocol and seed."""
        return {
            "robot": self.sticking.arm.name,
            "model_sha256": model_sha256(self.sticking),
            "interface": dataclasses.asdict(self.interface),
            "sensing": dataclasses.asdict(self.sensing),
            "scatter": self.scatter,
        }

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.sticking.arm.name}, seed {self.seed}>"

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.sticking.n


def joint_number(joint: int, n: int) -> int:
    """Return the number (from 0) of a joint of 1..n; raise a StictionError for another."""
    if not 1 <= joint <= n:
        raise unknown("joint", joint, range(1, n + 1))
    return joint - 1


FARTHEST = 0.05  # Largest distance by which scatter misses a pose [rad]; assumed
STRONGEST = 0.5  # Largest relative change of the dry friction by scatter [-]; assumed


class Rig:
    """N arms that servos bring to their poses, and whose joints are dithered."""

    def __init__(
        self,
        experiment: Experiment,
        nsim: int,
        *,
        approach: Approach,
        parameters: FrictionParameters | None = None,
        closed_loop: bool = False,
    ) -> None:
        """Make the arms.

        Args:
            experiment: arm, torque interface and scatter.
            nsim: number of arms.
            approach: numbers of the move to a pose, and of the scatter.
            parameters: friction of one arm or of each, None for the model's.
            closed_loop: whether the torque depends on the state in every control step.
        """
        sticking, self.interface = experiment.sticking, experiment.interface
        self.plant = Plant(
            sticking,
            nsim,
            parameters=parameters,
            threads=experiment.threads,
            closed_loop=closed_loop,
        )
        self.approach_numbers = approach
        self.nsim, self.n = nsim, sticking.n
        self.scatter, self.seed = experiment.scatter, experiment.seed
        self.dither = Dither.none(nsim, self.n)
        self.dither_phase = np.zeros((nsim, self.n))
        """(N, n) phase drawn for the dither of this iteration [rad]."""
        self.dither_seed = np.zeros(nsim, dtype=np.uint64)
        """(N,) seed drawn for the waveform ``random``."""
        self.step = np.zeros(nsim, dtype=np.int64)  # (N,) control steps of the present stage
        self._path = TorquePath(self.interface, nsim)
        self.senses: Senses | None = None
        """Senses of the controllers; None where controllers see the plant itself."""
        if not experiment.sensing.is_ideal:
            hold = self.interface.hold_steps
            self.senses = Senses(experiment.sensing, nsim, self.n, hold_steps=hold)
        self._sense_seed = np.zeros(nsim, dtype=np.uint64)
        self._servos = Servos(sticking, approach)

    def _servos_of(self, ids: Index, inertia: Array, mass: Array) -> tuple[Array, Array]:
        """Return stiffness [N·m/rad] and damping [N·m·s/rad] (M, n) that hold arms where they are.

        ``inertia`` and ``mass`` are those of `Servos.inertia` there.
        """
        signed, load = self.plant.load
        stiffness = self._servos.stiffness(self._servos.resistance(signed[ids], load[ids]))
        return stiffness, self._servos.damping(stiffness, inertia, mass)

    def _draw_pose_and_friction(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return by how much a pose is missed (n,) [rad], and factors of the dry friction (n,)."""
        p = self.approach_numbers
        shift = np.clip(p.pose_scatter * rng.normal(size=self.n), -FARTHEST, FARTHEST)
        change = np.clip(p.friction_scatter * rng.normal(size=self.n), -STRONGEST, STRONGEST)
        return shift, 1.0 + change

    def _draw_dither(self, i: int, rng: np.random.Generator) -> None:
        self.dither_phase[i] = rng.uniform(0, 2 * np.pi, size=self.n)
        self.dither_seed[i] = rng.integers(2**32)

    @property
    def seen_position(self) -> Array:
        """(N, n) link angles as the controllers have them [rad]."""
        return self.plant.position if self.senses is None else self.senses.q

    @property
    def seen_velocity(self) -> Array:
        """(N, n) link speeds as the controllers have them [rad/s]."""
        return self.plant.velocity if self.senses is None else self.senses.dq

    def _seed_senses(self, ids: Index, keys: Sequence[tuple[int, ...]]) -> None:
        if self.senses is not None:
            own = keys if self.scatter else [()] * len(keys)
            self._sense_seed[ids] = seeds_of(self.seed, own)

    def _rest_senses(self, ids: Index) -> None:
        """Restart the controllers of arms ``ids``, which rest, without a command."""
        if self.senses is not None:
            self.senses.reset(ids, self.plant.position[ids], self._sense_seed[ids])

    def set_dither(
        self,
        ids: Index,
        *,
        amplitude: ArrayLike,
        frequency: ArrayLike,
        waveform: ArrayLike = DEFAULT_WAVEFORM,
        offset: ArrayLike = 0.0,
        gate_velocity: ArrayLike = np.inf,
    ) -> None:
        """Set the dither of arms ``ids``, its phase that of the iteration.

        Arguments are as in `dither.Dither`, and broadcast to (M, n).
        """
        new = Dither(
            amplitude=np.broadcast_to(amplitude, (len(ids), self.n)),
            frequency=frequency,
            waveform=waveform,
            offset=offset,
            gate_velocity=gate_velocity,
            phase=self.dither_phase[ids],
            seed=self.dither_seed[ids],
        )
        self.dither = self.dither.set_rows(ids, new)

    def retune(self, amplitude: Array, frequency: Array) -> None:
        """Change A [N·m] and f [Hz] of all arms, (N, n), keeping each phase continuous."""
        self.dither = self.dither.retune(
            self._command_time(), amplitude=amplitude, frequency=frequency
        )

    def _command_time(self, ahead: int = 0) -> Array:
        """Return (N,) when the command of ``ahead`` control steps from now is computed [s]."""
        return np.multiply(self.interface.tick(self.step + ahead), CONTROL_DT, dtype=np.float64)

    def _gate_speed(self) -> Array | None:
        """Return the speeds (N, n) that gate the dither [rad/s], None where none is gated."""
        return self.seen_velocity if self.dither.gated else None


def dither_arrays(rows: Sequence[AmplitudeRow], n: int) -> dict[str, NDArray[np.generic]]:
    """Return (n,) arguments of `Rig.set_dither` for rows, at most one of a joint."""
    out = {
        "amplitude": np.zeros(n),
        "frequency": np.ones(n),
        "offset": np.zeros(n),
        "gate_velocity": np.full(n, np.inf),
        "waveform": np.full(n, DEFAULT_WAVEFORM, dtype=object),
    }
    for row in rows:
        j = joint_number(row.joint, n)
        out["amplitude"][j], out["offset"][j] = row.amplitude_nm, row.offset_nm
        out["waveform"][j] = row.waveform
        out["gate_velocity"][j] = row.gate_velocity
        if row.amplitude_nm > 0:
            out["frequency"][j] = row.frequency_hz
    return out


def minimum_jerk(x: NDArray[np.floating]) -> Array:
    """Return the share of a smooth move from rest to rest that is done after a share x of it."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)


def count_blocks(what: str, interval: float, block: float) -> int:
    """Return how many blocks [s] an interval [s], called ``what``, has; raise for a fraction."""
    blocks = round(interval / block) if np.isfinite(interval) else 0
    if blocks < 1 or abs(blocks * block - interval) > 1e-9:
        raise StictionError(f"{what} {interval}: expected one of the multiples of {block:g} s")
    return blocks
