"""What a Generated Trajectory Experiment is: its numbers, its trials and their results."""

from __future__ import annotations

import dataclasses
import functools
import tomllib
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np
from numpy.typing import NDArray

from stiction_envs.control.compensation import Compensation
from stiction_envs.control.trajectory import Path, pentagon, triangle
from stiction_envs.errors import StictionError, unknown
from stiction_envs.measured import AmplitudeRow

Array = NDArray[np.float64]
AXES = ("x", "y", "z", "roll", "pitch", "yaw")
TRAJECTORIES = ("triangle", "pentagon")
PHASES = ("random", "zero", "spread")
"""How the joints' dithers start: drawn for every joint and iteration (all 0 without scatter), all
at 0, or evenly spread over a period."""
FLAGS = ("singular", "saturated", "near_limit")
"""What a controller says of itself, see `control.impedance.Flags`."""


@dataclass(frozen=True, kw_only=True)
class GTEProtocol:
    """Numbers of the experiment; `gte.toml` has their sources."""

    iterations: int
    """Runs per case."""
    window: float
    """Half the window of Table 4.11 [s]."""
    sample_rate: float
    """Of the errors [Hz]."""
    model_steps: int
    """Control steps between two updates of the controller's model."""
    return_distance: float
    """How far joints are from the start before they are brought back [rad]."""
    tail: float
    """Time after the last goal is reached or given up [s]."""
    patience: float
    """Time a path may take beyond its movements and the generator's own patience before it is
    given up: counts only where that is inf (`MotionLimits.patience`) [s]."""
    vibration_low: float
    """Lowest frequency that counts as vibration [Hz]."""
    vibration_lever: float
    """How much translation a vibration of 1 rad counts as [m]."""

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            value = getattr(self, f.name)
            if not (np.isfinite(value) and value > 0):
                raise StictionError(f"protocol {f.name}: {value} must be finite and positive")
        if self.tail < self.window:
            raise StictionError(f"protocol tail: {self.tail} s ends before the window does")

    def replace(self, **changes: float) -> GTEProtocol:
        """Return a copy with some numbers changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


@functools.lru_cache
def _table() -> dict[str, dict[str, dict[str, object]]]:
    return tomllib.loads((File(__file__).parent / "gte.toml").read_text(encoding="utf-8"))


def load_gte_protocol() -> GTEProtocol:
    """Return the protocol of `gte.toml`."""
    return GTEProtocol(**{k: v["value"] for k, v in _table()["default"].items()})  # type: ignore[arg-type]


def named_path(name: str) -> Path:
    """Return the triangle or the pentagon.

    Raises:
        StictionError: another name.
    """
    if name not in TRAJECTORIES:
        raise unknown("trajectory", name, TRAJECTORIES)
    return triangle() if name == "triangle" else pentagon()


@dataclass(frozen=True, kw_only=True)
class Case:
    """One path at one stiffness with one dither and one compensation."""

    trajectory: str
    """Name of the path."""
    stiffness: tuple[float, float, float]
    """Translational [N/m], rotational [N·m/rad], nullspace [N·m/rad]."""
    dither: tuple[AmplitudeRow, ...] = ()
    """Of each dithered joint; empty is none."""
    gate_velocity: float = float("inf")
    """v_gate of the dither [rad/s]; inf is not gated."""
    compensation: Compensation | None = None
    """Of the joints' friction; None is none."""
    phases: str = "random"
    """One of :data:`PHASES`."""

    def __post_init__(self) -> None:
        if len(self.stiffness) != 3 or not all(0 <= k < np.inf for k in self.stiffness):
            raise StictionError(
                f"stiffness {self.stiffness}: expected three finite numbers >= 0 (KT KR KN)"
            )
        if self.phases not in PHASES:
            raise unknown("phases", self.phases, PHASES)

    @property
    def dithered(self) -> bool:
        """Whether any joint is shaken."""
        return any(r.amplitude_nm > 0 for r in self.dither)


def pose_error(actual: Array, reference: Array) -> Array:
    """Return actual less reference, (..., 6) poses x, y, z [m], roll, pitch, yaw [rad].

    Angles are in (−π, π].
    """
    error: Array = actual - reference
    error[..., 3:] = np.angle(np.exp(1j * error[..., 3:]))
    return error


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """All iterations of one case; K samples at the sample rate, from the first goal on."""

    case: Case
    time: Array
    """(K,) [s]."""
    reference: Array
    """(iterations, K, 6) pose of the reference: x, y, z [m], roll, pitch, yaw [rad]."""
    actual: Array
    """(iterations, K, 6) measured pose of the tool point, oriented as the hand."""
    accepted: Array
    """(iterations, goals) times at which goals were accepted [s]; NaN where never."""
    reached: Array
    """(iterations, goals) times at which goals were reached [s]; NaN where never."""
    mean_square: Array
    """(iterations, K, 6) mean square above `vibration_low` within each sample: of the position,
    then of turns about x, y, z times `vibration_lever` [m²]."""
    dither_power: Array
    """(iterations, K) mean of |dither torque · motor speed|, summed over joints [W]."""
    torque_rate: Array
    """(iterations, n) largest change of torque on each joint [N·m/s]."""
    flags: dict[str, NDArray[np.bool_]]
    """(iterations,) of each of :data:`FLAGS`: whether it was ever raised."""

    @property
    def error(self) -> Array:
        """(iterations, K, 6) actual less reference, angles in (−π, π] [m, rad]."""
        return pose_error(self.actual, self.reference)
