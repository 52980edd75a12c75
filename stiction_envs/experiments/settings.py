"""Constants of the experiments that are of the method, not of an arm; values in ``settings.toml``.

Protocols, which differ between arms, are in ``sje/sje.toml`` and ``gte/gte.toml``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.errors import StictionError
from stiction_envs.method_settings import check_numbers, load_settings


@dataclass(frozen=True, kw_only=True)
class ConformanceSettings:
    """When a simulated joint sticks."""

    under: float
    """Load over stiction under which it must hold [-]."""
    over: float
    """Load over stiction under which it must go [-]."""
    hold_time: float
    """Length of a hold [s]."""
    watched_time: float
    """End of a hold in which the joint may not move [s]."""
    rise_time: float
    """In which the load of a hold rises [s]."""
    go_time: float
    """Longest time to move away under the larger load [s]."""
    go_rise_time: float
    """In which that load rises [s]."""
    still: float
    """Largest motion of a joint that holds [rad]."""
    gone: float
    """Least motion of a joint that goes [rad]."""
    ramp_rates: tuple[float, ...]
    """At which breakaway torques are measured [N·m/s]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("under",))
        if self.over <= 1 or self.watched_time >= self.hold_time:
            raise StictionError(
                f"ConformanceSettings: over is {self.over:g}, watched_time {self.watched_time:g} s "
                f"of {self.hold_time:g} s: expected more than 1, and less than hold_time"
            )


@dataclass(frozen=True, kw_only=True)
class PoseSettings:
    """How the load and the no-load pose of a joint are searched."""

    swing: float
    """The joint is moved this far each way by the experiment [rad]."""
    margin: float
    """Distance of the joint under test from its limits [rad]: swing, start tolerance, overshoot."""
    others_margin: float
    """Distance of the other joints from their limits [rad]."""
    floor: float
    """Least height of the outer links of an upright arm over its base plane [m]."""
    rest_pull: float
    """Load that the root mean square distance from the rest pose, over the range, weighs [N·m]."""
    samples: int
    """Random poses at the beginning."""
    kept: int
    """Best of them that go on from round to round."""
    rounds: int
    """Of random steps about the kept ones."""
    first_step: float
    """Standard deviation of the first round's steps over the range [-]."""
    shrink: float
    """Factor of the steps from round to round [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("shrink",), from_zero=("rest_pull", "others_margin"))


@dataclass(frozen=True, kw_only=True)
class CalibrationSettings:
    """When a friction reproduces base torques."""

    tolerance: float
    """Rounds end when every base torque agrees this well, relative [-]."""
    converged: float
    """Times `tolerance` that the best round may be off [-]."""
    same_load: float
    """Loads of the two poses that differ by less cannot explain different friction [N·m]."""
    rounds: int
    """Most rounds of simulate and correct."""
    far: float
    """Relative error past which the table is a better start than the arm's friction [-]."""
    least_friction: float
    """Part of the table's friction that stiction keeps at least [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("least_friction",), from_zero=("tolerance",))


@dataclass(frozen=True, kw_only=True)
class OscillationSettings:
    """How far a dither shakes the joint under test before it breaks away."""

    share: float
    """The ramp counts until the joint has moved by this part of the threshold [-]."""
    highpass: float
    """Corner over the dither's frequency of the high-pass that takes creep out of the speed [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("share", "highpass"))


@dataclass(frozen=True, kw_only=True)
class PushSettings:
    """How a person pushes a joint, and when it has stopped."""

    step: float
    """By which a push grows at a time, over what the joint holds [-]."""
    rise_time: float
    """In which the torque grows by what the joint holds [s]."""
    watched_time: float
    """A joint has stopped that is in the mean where it was this much earlier [s]."""
    still: float
    """How far apart those two places may be [rad]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("step",))


@dataclass(frozen=True, kw_only=True)
class HoldSettings:
    """How joints are held that are not under test."""

    torque_margin: float
    """Least torque limit, over what resists the joint, that a servo's stiffness counts with [-]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class ExperimentSettings:
    """All of this room."""

    conformance: ConformanceSettings
    """Does a joint stick."""
    poses: PoseSettings
    """Load and no-load poses."""
    calibration: CalibrationSettings
    """Friction from base torques."""
    oscillation: OscillationSettings
    """Displacement by dither."""
    push: PushSettings
    """A joint that a person pushes."""
    hold: HoldSettings
    """Servos of the other joints."""


@cache
def experiment_settings() -> ExperimentSettings:
    """Return the defaults."""
    return load_settings(ExperimentSettings, Path(__file__).with_name("settings.toml"))
