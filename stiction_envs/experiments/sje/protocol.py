"""Numbers, configurations, jobs and results of the Single Joint Experiment."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stiction_envs.arrays import Array
from stiction_envs.dither.waveforms import DEFAULT_WAVEFORM
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.holding_servos import Approach
from stiction_envs.experiments.rig import joint_number
from stiction_envs.measured.tables import DIRECTIONS, LOADS, AmplitudeRow
from stiction_envs.method_settings import NotNegative, Positive, load_settings, override
from stiction_envs.robots.arm_toml import read_toml
from stiction_envs.robots.registry import ARMS

POSES = {"load": "load pose", "no_load": "no-load pose"}  # As pages write loads
SIGNS = {"+": "+", "-": "−"}
_TOML = Path(__file__).with_name("sje.toml")


@dataclass(frozen=True, kw_only=True)
class Protocol(Approach):
    """Numbers of the experiment; `sje.toml` has their sources."""

    ramp_rate: Positive  # Growth of the commanded torque [N·m/s]
    threshold: Positive  # Angle from the ramp's start at which a joint has broken away [rad]
    iterations: Positive  # Repeats per configuration
    start_tolerance: NotNegative
    """Largest distance of any joint from the pose when a ramp starts [rad]."""
    rest_speed: NotNegative  # Fastest joint speed at a ramp's start [rad/s]
    patience: NotNegative  # A ramp starts after this many approaches, at rest or not [-]
    averaged_start_torque: NotNegative  # 1: from the averaged torque (iiwa), 0: from zero (Panda)
    averaging_time: NotNegative  # Time over which that torque is averaged [s]
    give_up_factor: NotNegative  # A ramp ends as stuck at this multiple of stiction plus offset [-]
    torque_noise: NotNegative  # Standard deviation of a torque reading [N·m]

    def replace(self, **changes: float) -> "Protocol":
        """Return a copy with some numbers changed; raise for an unknown name or a bad number."""
        return override(self, changes)


@dataclass(frozen=True, kw_only=True)
class SJERewardSettings:
    """Weights of the environment's penalties, and the least frequency of shaking."""

    power_weight: Positive  # Weight of the mean of (A / A_max)² [-]
    torque_rate_weight: Positive  # Weight of the mean of (2πfA / torque rate limit)² [-]
    shaking_weight: Positive  # Weight of (oscillation / threshold)² [-]
    shaking_corner: Positive  # Joints oscillate above this frequency [Hz]; see `Oscillation`


def sje_reward_settings() -> SJERewardSettings:
    """Return the defaults."""
    return load_settings(SJERewardSettings, _TOML, "reward")


def load_protocol(robot: str | None, *, position: bool = False) -> Protocol:
    """Return the protocol of a registered arm: `sje.toml`, and what its TOML says otherwise.

    ``position`` is whether position servos drive its joints. Raise a StictionError for an arm's
    ``[experiments.sje.NAME]`` that is no number of the protocol.
    """
    protocol, arm = load_settings(Protocol, _TOML, "default"), ARMS.get(str(robot))
    if position:
        servos = read_toml(_TOML)["servos"]
        protocol = protocol.replace(**{name: entry["value"] for name, entry in servos.items()})
    own = {} if arm is None else arm.table.get("experiments", {}).get("sje", {})
    try:
        return override(protocol, own)
    except StictionError as error:
        raise StictionError(f"{arm and arm.toml}: [experiments.sje] {error}") from None


@dataclass(frozen=True, order=True)
class Configuration:
    """A joint, its pose and the direction of the ramp."""

    joint: int  # 1..n, counted from the base
    load: str  # ``load`` or ``no_load``
    direction: str  # ``+`` or ``-``

    def __post_init__(self) -> None:
        if self.load not in LOADS:
            raise unknown("load", self.load, LOADS)
        if self.direction not in DIRECTIONS:
            raise unknown("direction", self.direction, DIRECTIONS)

    @property
    def sign(self) -> float:
        """+1 or −1."""
        return 1.0 if self.direction == "+" else -1.0

    @property
    def index(self) -> tuple[int, int, int]:
        """(joint from 0, 0 load / 1 no load, 0 plus / 1 minus)."""
        return self.joint - 1, LOADS.index(self.load), DIRECTIONS.index(self.direction)


def configurations(n: int, joints: list[int] | None = None) -> list[Configuration]:
    """Return the 4n configurations of an arm, or those of some joints (1..n)."""
    for joint in joints or []:
        joint_number(joint, n)
    chosen = sorted(set(joints)) if joints else list(range(1, n + 1))
    return [Configuration(j, load, d) for j in chosen for load in LOADS for d in DIRECTIONS]


@dataclass(frozen=True, order=True)
class Job:
    """One configuration with one dither on the joint under test."""

    configuration: Configuration
    frequency_hz: float = 0.0
    amplitude_nm: float = 0.0
    waveform: str = DEFAULT_WAVEFORM
    offset_nm: float = 0.0
    gate_velocity: float = float("inf")
    replica: int = 0  # Repeats of the same job with scatter of their own

    @classmethod
    def of(cls, configuration: Configuration, row: AmplitudeRow) -> "Job":
        """Return a configuration with the dither of its joint, or without where that has none."""
        if row.amplitude_nm == 0:
            return cls(configuration)
        return cls(
            configuration,
            frequency_hz=row.frequency_hz,
            amplitude_nm=row.amplitude_nm,
            waveform=row.waveform,
            offset_nm=row.offset_nm,
            gate_velocity=row.gate_velocity,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """Results of the iterations of one job."""

    job: Job
    tau: Array  # (iterations,) signed commanded torque, dither excluded, at the threshold [N·m]
    start: Array  # (iterations,) angle of the joint from the pose at its ramp's start [rad]
    start_torque: Array  # (iterations,) torque at which the ramp started [N·m]
    shaken_speed: Array  # (iterations,) RMS speed of the joint before breakaway [rad/s]
    traces: tuple[NDArray[np.float32], ...]  # Angle from the pose every `trace_dt` [rad]
    trace_dt: float  # Sampling time of the traces [s]

    @property
    def mean(self) -> float:
        """Mean torque [N·m]; NaN if an iteration was stuck."""
        return float(self.tau.mean())

    @property
    def is_base(self) -> bool:
        """True if the ramp was without dither and offset."""
        return self.job.amplitude_nm == 0 and self.job.offset_nm == 0

    @property
    def is_stuck(self) -> bool:
        """True if an iteration ended without reaching the threshold."""
        return not np.isfinite(self.mean)

    @property
    def displacement(self) -> float:
        """Root mean square oscillation of the joint before breakaway [rad]; 0 without dither.

        From its speed, v/(2πf): the angle itself has creep in it.
        """
        f = self.job.frequency_hz
        return float(np.sqrt(np.mean(self.shaken_speed**2)) / (2 * np.pi * f)) if f else 0.0

    @property
    def std(self) -> float:
        """Standard deviation over the iterations [N·m]."""
        return float(self.tau.std(ddof=1)) if len(self.tau) > 1 else 0.0
