"""The protocol of the Generated Trajectory Experiment, its trials and their results."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np
from numpy.typing import ArrayLike

from stiction_envs.arrays import Array, Bools
from stiction_envs.control.compensation import Compensation
from stiction_envs.control.trajectory import Path, pentagon, read_path, triangle
from stiction_envs.errors import StictionError, checked_array, unknown
from stiction_envs.measured.tables import AmplitudeRow, read_amplitudes
from stiction_envs.method_settings import (
    Amount,
    Count,
    Positive,
    Share,
    checked,
    load_settings,
    override,
)
from stiction_envs.robots import Arm

Stiffness = tuple[Amount, Amount, Amount]  # Translational [N/m], rotational and nullspace [N·m/rad]
_TOML = File(__file__).with_name("gte.toml")
AXES = ("x", "y", "z", "roll", "pitch", "yaw")
PATHS: dict[str, Callable[[], Path]] = {"triangle": triangle, "pentagon": pentagon}
TRAJECTORIES = tuple(PATHS)
FLAGS = ("singular", "saturated", "near_limit")
"""Flags of the controller, see `control.impedance.read_flags`."""


@dataclass(frozen=True, kw_only=True)
class GTEProtocol:
    """Numbers of the experiment; `gte.toml` has their sources."""

    iterations: Count  # Runs per case
    window: Positive  # Half the window of Table 4.11 [s]
    sample_rate: Positive  # Rate at which errors are sampled [Hz]
    model_steps: Count  # Control steps between two updates of the controller's model
    return_distance: Positive  # Distance of joints from the start before their return [rad]
    tail: Positive  # Time after the last goal is reached [s]
    vibration_low: Positive  # Lowest frequency that counts as vibration [Hz]
    vibration_lever: Positive  # How much translation a vibration of 1 rad counts as [m]

    def __post_init__(self) -> None:
        if self.tail < self.window:
            raise StictionError(f"protocol tail: {self.tail} s ends before the window does")

    def replace(self, **changes: float) -> "GTEProtocol":
        """Return a copy with some numbers changed; raise for an unknown name or a bad number."""
        return override(self, changes)


def load_gte_protocol() -> GTEProtocol:
    """Return the protocol of `gte.toml`."""
    return load_settings(GTEProtocol, _TOML, "default")


@dataclass(frozen=True, kw_only=True)
class EpisodeSettings:
    """Ranges from which an episode of the environment is drawn."""

    stiffness: tuple[Stiffness, ...]  # Stiffnesses of the triangle and the pentagon
    random_paths: Count  # How many are drawn from
    undithered_iterations: Count  # Iterations of a random path whose mean is the unit of the reward


def episode_settings() -> EpisodeSettings:
    """Return the defaults."""
    return load_settings(EpisodeSettings, _TOML, "episode")


@dataclass(frozen=True, kw_only=True)
class GTERewardSettings:
    """Weights of the environment's reward, and the unit of its shaking."""

    settling_weight: Share  # Weight of the error left at the goals; that of tracking is 1 less it
    power_weight: Positive  # Weight of the mean of (A / A_max)² [-]
    torque_rate_weight: Positive  # Weight of the mean of (2πfA / torque rate limit)² [-]
    shaking_weight: Positive  # Weight of the vibration [-]
    shaking_unit: Positive  # Unit of the vibration [m]


def gte_reward_settings() -> GTERewardSettings:
    """Return the defaults."""
    return load_settings(GTERewardSettings, _TOML, "reward")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One path at one stiffness with one dither and one compensation."""

    trajectory: str  # Name of the path
    stiffness: Stiffness
    dither: tuple[AmplitudeRow, ...] = ()  # Dither of each dithered joint; empty is none
    compensation: Compensation | None = None  # Compensation of the joints' friction; None is none

    def __post_init__(self) -> None:
        checked(self.stiffness, Stiffness, "stiffness KT KR KN")

    @property
    def dithered(self) -> bool:
        """True if any joint is dithered."""
        return any(r.amplitude_nm > 0 for r in self.dither)


def pose_error(actual: Array, reference: Array) -> Array:
    """Return actual less reference, (..., 6) poses [m, rad]; angles are in (−π, π]."""
    error: Array = actual - reference
    error[..., 3:] = np.angle(np.exp(1j * error[..., 3:]))
    return error


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """All iterations of one case; K samples at the sample rate, from the first goal on."""

    case: Case
    time: Array  # (K,) [s]
    reference: Array  # (iterations, K, 6) reference: x, y, z [m], roll, pitch, yaw [rad]
    actual: Array  # (iterations, K, 6) measured pose of the tool point, oriented as the hand
    accepted: Array  # (iterations, goals) times at which goals were accepted [s]
    reached: Array  # (iterations, goals) times at which goals were reached [s]
    mean_square: Array
    """(iterations, K, 6) mean square above `vibration_low` within each sample: of the position,
    then of turns about x, y, z times `vibration_lever` [m²]."""
    dither_power: Array  # (iterations, K) mean of |dither torque · motor speed| of all joints [W]
    torque_rate: Array  # (iterations, n) largest change of torque on each joint [N·m/s]
    flags: dict[str, Bools]  # (iterations,) of each of :data:`FLAGS`: whether it was ever raised

    @property
    def error(self) -> Array:
        """(iterations, K, 6) actual less reference, angles in (−π, π] [m, rad]."""
        return pose_error(self.actual, self.reference)


def read_trajectory(text: str | File) -> Path | None:
    """Return the path of a CSV file; None for a path by name; raise for anything else."""
    if str(text) in TRAJECTORIES:
        return None
    if not str(text).lower().endswith(".csv"):
        raise unknown("trajectory", str(text), [*TRAJECTORIES, "a path to a .csv"])
    return read_path(str(text))


def start_angles(arm: Arm, start: ArrayLike | None) -> Array:
    """Return the joint angles (n,) [rad] at which arms start, the rest pose for None.

    Raise a StictionError for other than n numbers, or one that is not within the limits.
    """
    expected = f"{arm.n} angles in rad, one per joint of {arm.name}"
    q = checked_array(arm.rest if start is None else start, "start", (arm.n,), expected=expected)
    low, high = arm.limits.position.T
    for j in np.flatnonzero(~((q > low) & (q < high))):
        raise StictionError(
            f"start: joint {j + 1}: {q[j]:g} rad: expected angles within the limits, "
            f"{low[j]:g} to {high[j]:g}"
        )
    return q


def read_dither(table: str | File, arm: Arm) -> tuple[AmplitudeRow, ...]:
    """Return the rows of an amplitude table.

    Raise a StictionError for an unreadable table, no dithered joint, or more than the arm takes.
    """
    rows = read_amplitudes(
        table,
        n_joints=arm.n,
        torque_limit=arm.limits.torque,
        controller_rate_hz=arm.controller_rate_hz,
    )
    if not any(row.amplitude_nm > 0 for row in rows):
        raise StictionError(f"{table}: dithers no joint: expected an amplitude_nm above 0")
    return tuple(rows)


def with_and_without(
    trajectory: str,
    stiffness: Stiffness,
    dither: Sequence[AmplitudeRow] = (),
    *,
    compensation: Compensation | None = None,
) -> list[Case]:
    """Return the case without anything, then those with dither, with compensation, with both."""
    cases = [Case(trajectory=trajectory, stiffness=stiffness)]
    if dither:
        cases.append(dataclasses.replace(cases[0], dither=tuple(dither)))
    if compensation is not None:
        cases += [dataclasses.replace(case, compensation=compensation) for case in cases]
    return cases
