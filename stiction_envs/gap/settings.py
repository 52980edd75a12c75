"""Constants of going from logs to causes; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.measured.settings import MeasuredSettings, measured_settings
from stiction_envs.method_settings import check_numbers, load_settings


@dataclass(frozen=True, kw_only=True)
class SpectraSettings:
    """Which cutoff leaves the signal and takes the noise."""

    harmonics: float
    """The band of the torque reaches at least to this harmonic of the motion [-]: dry friction
    jumps at each reversal."""
    motion_share: float
    """The motion ends at the frequency below which this share of the speed's power lies [-]."""
    accurate: float
    """Noise of the acceleration that does no harm, as a share of its root mean square [-]."""
    accurate_absolute: float
    """The same where the arm hardly accelerates [rad/s²]: 0.05 N·m at 1 kg·m²."""
    highest: float
    """Largest cutoff as a share of the sampling rate [-]."""
    lowest_hz: float
    """Smallest cutoff that is chosen [Hz]."""
    periods: float
    """Periods of the cutoff that a segment must last [-]."""
    most_rows: int
    """Rows of all logs that are looked at: a long log must not take minutes."""
    stretches: int
    """Into which a longer segment is cut, spread over it."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("motion_share", "highest"))


@dataclass(frozen=True, kw_only=True)
class PrepareSettings:
    """What is left of a segment after the filter."""

    trim_periods: float
    """Periods of the cutoff that are cut off at each end, where the filter guesses [-]: the error
    of the acceleration is 0.3 % there; never more than `trim_share` of a segment."""
    trim_share: float
    """Largest share of a segment that is cut off at each end [-]."""
    least_rate: float
    """Samples per period of the cutoff that are kept at least [-]."""
    most_samples: int
    """That are kept of all logs together, unless the caller says so."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("trim_share",), from_zero=("trim_periods", "trim_share"))


@dataclass(frozen=True, kw_only=True)
class ReversalPathSettings:
    """How angles lose overshoot and noise before friction turns on them."""

    wider: float
    """Cutoff for them over that of all signals [-]."""
    noise_band: float
    """Half width of the play over the noise that is left [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, from_zero=("noise_band",))


@dataclass(frozen=True, kw_only=True)
class TorqueSignSettings:
    """When torques are counted the other way round."""

    least_load: float
    """Rigid-body torque, standard deviation, from which on a joint has a say [N·m]."""
    opposite: float
    """Correlation of measured and rigid-body torque from which on a sign is certain [-]."""
    residual_left: float
    """What must be left of the residual after the sign is turned [-]."""
    clear_direction: float
    """Smoothed direction, in [-1, 1], from which on a joint counts as moving that way [-]."""
    most_rows: int
    """Rows of a log that are looked at, evenly picked."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("opposite", "residual_left", "clear_direction"))


@dataclass(frozen=True, kw_only=True)
class TorqueLagSettings:
    """When torques come after the angles they belong to."""

    longest_delay: float
    """That is tried [s]."""
    delay_step: float
    """Between delays that are tried [s]."""
    lowpasses: tuple[float, ...]
    """Time constants that are tried [s]."""
    finer_reach: float
    """How far about the best delay finer ones are tried [s]."""
    finer_step: float
    """Between them [s]."""
    finer_lowpasses: tuple[float, ...]
    """Steps of the time constant about the best one [s]."""
    least_lag: float
    """Delay and time constant together from which on a load's torque is corrected [s]: more than
    the cause `actuator_delay` can hold, which names what is shorter."""
    least_friction_lag: float
    """The same where only friction shows it, which that cause does not [s]."""
    residual_left: float
    """What must be left of the residual; else nothing is done [-]."""
    hint_left: float
    """What must be left of it at one of `first_delays` for a closer look [-]."""
    first_delays: tuple[float, ...]
    """Of the first look [s]."""
    least_runs: int
    """Runs that tell a time from a distance."""
    speed_ratio: float
    """Fastest over slowest of them, at least [-]."""
    lag_ratio: float
    """Largest over smallest lag of these runs for a time [-]; a distance would have `speed_ratio`
    or more."""
    first_rows: int
    """Rows of a log at the first look."""
    most_rows: int
    """The same at the closer look."""

    def __post_init__(self) -> None:
        check_numbers(
            self,
            shares=("residual_left", "hint_left"),
            from_zero=("lowpasses", "least_friction_lag"),
            signed=("finer_lowpasses",),
        )


@dataclass(frozen=True, kw_only=True)
class GapSettings:
    """All of this room, and of the logs it reads."""

    measured: MeasuredSettings
    """Reading and correcting logs; `MeasuredSettings.motion` says when a joint moves."""
    spectra: SpectraSettings
    """The cutoff."""
    prepare: PrepareSettings
    """What is left after the filter."""
    reversal_path: ReversalPathSettings
    """Where friction turns."""
    torque_sign: TorqueSignSettings
    """Torques counted the other way round."""
    torque_lag: TorqueLagSettings
    """Torques that come late."""


@cache
def gap_settings() -> GapSettings:
    """Return the defaults."""
    path = Path(__file__).with_name("settings.toml")
    return GapSettings(
        measured=measured_settings(),
        spectra=load_settings(SpectraSettings, path, "spectra"),
        prepare=load_settings(PrepareSettings, path, "prepare"),
        reversal_path=load_settings(ReversalPathSettings, path, "reversal_path"),
        torque_sign=load_settings(TorqueSignSettings, path, "torque_sign"),
        torque_lag=load_settings(TorqueLagSettings, path, "torque_lag"),
    )
