"""Method constants of this room; values and sources are in ``settings.toml`` beside this file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import check_numbers, load_settings


@dataclass(frozen=True, kw_only=True)
class IdentificationSettings:
    """The simulated trajectories on which the thesis's identification is repeated."""

    rate: float
    """Samples per second [Hz]."""
    seconds: float
    """Length of a log [s]."""
    slow_hz: float
    """Lowest of four frequencies of the motion [Hz]."""
    slow_angle: float
    """Largest angle of a joint from the rest pose [rad]."""
    fast_hz: float
    """Lowest frequency of the motion without slow data [Hz]."""
    fast_speed: float
    """Largest speed of a joint there [rad/s]."""
    bands: tuple[float, ...]
    """Stiction bands of the Panda's joints [N·m]."""
    coulomb_ratio: float
    """Coulomb friction over the band [-]."""
    stribeck_velocity: float
    """[rad/s]."""
    viscous: float
    """Viscous friction over the band [s/rad]."""
    torque_noise: float
    """Standard deviation of a logged torque [N·m]."""
    speed_noise: float
    """Standard deviation of a logged speed, of which accelerations are differences [rad/s]."""
    speed_lag: float
    """Time constant of a filtered speed [s]."""
    hand: tuple[float, ...]
    """Mass [kg] and centre of mass [m] of a hand that the model does not know."""
    every: int
    """The lines are fitted to every so many samples."""

    def __post_init__(self) -> None:
        check_numbers(self, from_zero=("hand",))


@dataclass(frozen=True, kw_only=True)
class CurveSettings:
    """The simulated friction curve of one joint, Figure 2.3."""

    slowest: float
    """[rad/s]."""
    fastest: float
    """[rad/s]."""
    speeds: int
    """Of each direction, evenly on a logarithmic scale."""
    travel: float
    """Least angle that a joint is moved at each speed [rad]."""
    least_time: float
    """Shortest motion [s]."""
    averaged: float
    """Share of the motion, at its end, over which the torque is averaged [-]."""
    servo_frequency: float
    """Natural frequency of the servo that moves the joint [Hz]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("averaged",))


@dataclass(frozen=True, kw_only=True)
class CostSettings:
    """What work takes, roughly, so that one progress bar can count all of it [s]."""

    simulated_arm: float
    """A simulated second of a Single Joint Experiment."""
    simulated_path: float
    """A simulated second of a Generated Trajectory Experiment."""
    fit: float
    """A simulated log, its lines and links."""
    curve: float
    """The friction curve."""
    set_up: float
    """A set-up of the ensemble."""
    drawing: float
    """A figure."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class ThesisSettings:
    """All of the room."""

    identification: IdentificationSettings
    """Tables 4.1, 4.2, 4.4 and A.1."""
    curve: CurveSettings
    """Figure 2.3."""
    cost: CostSettings
    """For the progress bar."""


@cache
def thesis_settings() -> ThesisSettings:
    """Return the settings of `settings.toml`."""
    return load_settings(ThesisSettings, Path(__file__).parent / "settings.toml")
