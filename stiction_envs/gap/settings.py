"""Constants of going from logs to causes; values are in ``settings.toml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from stiction_envs.gap.model_settings import (
    CheckSettings,
    ExtendedModelSettings,
    ForwardSettings,
    LeastSquaresSettings,
)
from stiction_envs.gap.tables.settings import TableSettings
from stiction_envs.measured.settings import MeasuredSettings, MotionThresholds, measured_settings
from stiction_envs.method_settings import check_numbers, load_settings

PATH = Path(__file__).with_name("settings.toml")


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
    most_rate: float
    """The same at most [-]: what was filtered has nothing between them."""
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
class RecordingSettings:
    """How the logs' time is cut into blocks that are held out."""

    most_rows: int
    """Rows of all logs together; longer logs are thinned out after the filter, which is told."""
    blocks: int
    """Of time that are held out in turn, over all logs: enough to see their spread."""
    guard: float
    """Time between two blocks that belongs to none [s]; longer than any filter here."""

    def __post_init__(self) -> None:
        check_numbers(self, from_zero=("guard",))


@dataclass(frozen=True, kw_only=True)
class FrictionStateSettings:
    """What is assumed of dry friction before causes are looked for."""

    presliding_distance: float
    """Of dry friction [rad]: 0.5 N·m on 2500 N·m/rad."""
    presliding_distances: tuple[float, ...]
    """Of which each joint takes the one that its torque at reversals asks for [rad]."""
    falling_speed: float
    """Speed over which friction may fall meanwhile [rad/s]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class NoiseSettings:
    """The noise floor of the residual."""

    least_noise: float
    """That is assumed at least [N·m], so that perfect data do not divide by zero."""
    same_pose: float
    """Poses nearer than this, over all joints, are one pose [rad]: 0.2 N·m of gravity in
    7 N·m/rad, before the model takes it out."""
    least_pairs: int
    """Fewer pairs of such poses say nothing of the scatter."""
    seen: float
    """Times the noise floor by which a torque must change to be seen [-]."""
    clear: float
    """The same for a torque that scales or shifts what a cause adds [-]."""
    falling: float
    """Drop of the torque's spectrum over the octave past the band from which on it was low-passed
    before it was logged [-]; a first order has 4, white noise 1."""
    longest_window: float
    """For the spectrum in which slow noise is looked for [s]: two periods of the slowest."""
    least_windows: float
    """Of them that the longest run holds side by side, at least."""
    level: float
    """Of a spectrum over its median in the octave above, at most, where it falls no more [-]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class SessionSettings:
    """Which logs were recorded together."""

    cold_after: float
    """Pause after which gears are cold again [s]: three of their time constants."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class CandidateSettings:
    """How rows of the logs weigh."""

    huber: float
    """Residuals beyond this many robust standard deviations weigh less [-]."""
    uncertain: float
    """Weight of rows in which a joint rests off its steady level of friction [-]: how far it sprang
    back is hardly seen, so that its torque is known to some 0.2 of its friction only, five times
    the noise of a good log."""
    sure: float
    """Part of that level from which on friction counts as steady [-]."""
    mostly: float
    """Part of the rows at rest from which on they count as the others do [-]."""
    given: float
    """Part of the nominal model's friction that it may be off, where it is given [-]."""
    diagnosed: float
    """The same where it is of an earlier diagnosis [-]."""
    edge: float
    """Nonlinear parameters within this factor of the last that were tried are at the end [-]."""
    prior_rows: float
    """Independent observations at the noise floor that a prior counts as [-]: models leave more
    than the noise."""

    def __post_init__(self) -> None:
        check_numbers(
            self, shares=("uncertain", "sure", "mostly"), from_zero=("given", "diagnosed")
        )


@dataclass(frozen=True, kw_only=True)
class SelectionSettings:
    """When a cause is significant, and which of two that are."""

    chance: float
    """Chance that anything at all is named by noise, shared out over all that is tried [-]."""
    clear: float
    """Part of a joint's held-out squared error that noise never explains [-]: it has thousands of
    rows. A cause that takes away more is not held against chance over all that is tried."""
    least_torque: float
    """Least torque of a cause, root mean square, over the noise floor of some joint [-]."""
    refinement: float
    """Part of the torque of a joint's approximate causes that a refinement must have [-]: better no
    law of friction is known. Base friction refines nothing."""
    as_good: float
    """What explains as much but for this part is as good [-]."""
    as_good_errors: float
    """The same in standard errors, as long as the part is not five times as large [-]."""
    pair_error: float
    """Held-out error of a joint over its noise from which on pairs of causes are tried [-]."""
    rounds: int
    """Times that is added and taken out at most."""
    most_terms: int
    """Of a model."""
    shortlist: int
    """Causes per joint whose held-out error is worked out in each round."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("chance", "clear", "as_good"))


@dataclass(frozen=True, kw_only=True)
class AngleRangeSettings:
    """When a torque over the angle holds at angles that were left out."""

    ranges: int
    """Of a joint's angle that are left out in turn, the joint travels as far in each."""
    chance: float
    """Chance that noise holds there, which blocks of time have not refuted before [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("chance",))


@dataclass(frozen=True, kw_only=True)
class EstimateSettings:
    """Parameters of the causes, and their intervals."""

    resamples: int
    """Of the blocks."""
    interval: float
    """Standard deviations of the resamples in an interval [-]: Student's t of 11 degrees of
    freedom."""
    far: float
    """Robust standard deviations at which resamples are cut off [-]."""
    model_error: float
    """Part of a value to which any model is true at best [-]."""
    resized: int
    """Rounds in which nonlinear parameters follow sizes."""
    resized_reach: float
    """How far the logarithm of a parameter then moves [-]."""
    tangent: float
    """Step in the logarithm of a nonlinear parameter for its tangent [-]."""
    delay_rounds: int
    """Times that a delay follows the model it is a part of."""
    hardly_own: float
    """Part of a cause's own gain that it may lose to another which explains the same [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, from_zero=("model_error",))


@dataclass(frozen=True, kw_only=True)
class VerdictSettings:
    """When nothing is left to explain."""

    close: float
    """Held-out error over the noise floor under which nothing is left [-]."""
    small: float
    """The same over a joint's whole torque, root mean square [-]."""
    minor: float
    """Part of the nominal residual, mean over joints, under which a cause is minor [-]."""
    minor_error: float
    """Where, besides, no joint's held-out error grows by more than this factor without it [-]."""

    def __post_init__(self) -> None:
        check_numbers(self)


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
    recording: RecordingSettings
    """Blocks of time."""
    friction_state: FrictionStateSettings
    """Dry friction before causes are looked for."""
    noise: NoiseSettings
    """The noise floor."""
    sessions: SessionSettings
    """Which logs were recorded together."""
    candidates: CandidateSettings
    """Weights of rows."""
    selection: SelectionSettings
    """Which causes."""
    angle_ranges: AngleRangeSettings
    """Torques over the angle."""
    estimates: EstimateSettings
    """Their parameters."""
    verdict: VerdictSettings
    """When nothing is left to explain."""
    check: CheckSettings
    """Logs that took no part."""
    forward: ForwardSettings
    """Both models in simulation."""
    extended_model: ExtendedModelSettings
    """What was found as a model."""
    least_squares: LeastSquaresSettings
    """The thesis's lines."""
    tables: TableSettings
    """Torque tables."""
    causes: Mapping[str, Any] = field(default_factory=dict)
    """Those of the causes, by name: each is a frozen dataclass in the cause's own file."""

    @property
    def motion(self) -> MotionThresholds:
        """When a joint moves: that of `measured`."""
        return self.measured.motion


@cache
def gap_settings() -> GapSettings:
    """Return the defaults, but for those of the causes: `causes.default_settings` has all."""
    kinds = get_type_hints(GapSettings)
    own = {x: load_settings(kinds[x], PATH, x) for x in kinds if x not in ("measured", "causes")}
    return GapSettings(measured=measured_settings(), **own)
