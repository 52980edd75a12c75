"""Constants of the experiments' method, the same for every arm; values in ``settings.toml``.

Protocols, which differ between arms, are in ``sje/sje.toml`` and ``gte/gte.toml``.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.errors import StictionError
from stiction_envs.method_settings import Count, NotNegative, Positive, Share, load_settings


@dataclass(frozen=True, kw_only=True)
class ConformanceSettings:
    """Test whether a simulated joint sticks."""

    under: Share
    """Load over stiction under which the joint must hold [-]."""
    over: Positive
    """Load over stiction under which it must move [-]."""
    hold_time: Positive
    """Length of a hold [s]."""
    watched_time: Positive
    """End of a hold in which the joint may not move [s]."""
    rise_time: Positive
    """Time in which the load of a hold rises [s]."""
    go_time: Positive
    """Longest time until the joint moves under the larger load [s]."""
    go_rise_time: Positive
    """Time in which that load rises [s]."""
    still: Positive
    """Largest motion of a joint that holds [rad]."""
    still_single: Positive
    """The same in an engine of float32 [rad]."""
    gone: Positive
    """Least motion of a joint that moves away [rad]."""
    ramp_rates: tuple[Positive, ...]
    """Torque rates at which breakaway torques are measured [N·m/s]."""

    def used(self) -> dict[str, object]:
        """Return the constants of a test; `still` is that of its engine."""
        out = dataclasses.asdict(self)
        del out["still_single"]
        return out

    def __post_init__(self) -> None:
        if self.over <= 1 or self.watched_time >= self.hold_time:
            raise StictionError(
                f"ConformanceSettings: over is {self.over:g}, watched_time {self.watched_time:g} s "
                f"of {self.hold_time:g} s: expected more than 1, and less than hold_time"
            )


@dataclass(frozen=True, kw_only=True)
class PoseSettings:
    """Search for the load and the no-load pose of a joint."""

    swing: Positive
    """The experiment moves the joint this far each way [rad]."""
    margin: Positive
    """Distance of the joint under test from its limits [rad]: swing, start tolerance, overshoot."""
    others_margin: NotNegative
    """Distance of the other joints from their limits [rad]."""
    floor: Positive
    """Least height of the outer links of an upright arm over its base plane [m]."""
    rest_pull: NotNegative
    """Weight of the distance (root mean square, over the range) from the rest pose [N·m]."""
    samples: Count
    """Random poses at the beginning."""
    kept: Count
    """Number of the best poses that each round keeps."""
    rounds: Count
    """Rounds of random steps about the kept poses."""
    first_step: Positive
    """Standard deviation of the first round's steps, over the range [-]."""
    shrink: Share
    """Factor of the steps from round to round [-]."""


@dataclass(frozen=True, kw_only=True)
class CalibrationSettings:
    """When the calibrated friction reproduces the base torques."""

    tolerance: NotNegative
    """Rounds end when every base torque agrees this well, relative [-]."""
    converged: Positive
    """Largest error of the best round, over `tolerance` [-]."""
    rounds: Count
    """Most rounds of simulate and correct."""
    far: Positive
    """Above this relative error the table is a better start than the arm's friction [-]."""
    least_friction: Share
    """Least stiction over the table's friction [-]."""


@dataclass(frozen=True, kw_only=True)
class ExperimentSettings:
    """All settings of this package."""

    conformance: ConformanceSettings
    """Test whether a joint sticks."""
    poses: PoseSettings
    """Load and no-load poses."""
    calibration: CalibrationSettings
    """Friction from base torques."""


@cache
def experiment_settings() -> ExperimentSettings:
    """Return the defaults."""
    return load_settings(ExperimentSettings, Path(__file__).with_name("settings.toml"))
