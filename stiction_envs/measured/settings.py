"""Constants of reading, correcting and checking measured data; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import check_numbers, load_settings


@dataclass(frozen=True, kw_only=True)
class FileSettings:
    """How large a log may be: files come from strangers."""

    most_bytes: int
    """Of one file, unpacked."""
    most_values: int
    """Numbers of one file that are used; 50 minutes at 1 kHz of t, q, dq and tau of 7 joints."""
    most_line_bytes: int
    """Of one line of text."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class ReaderSettings:
    """Time of a log as a whole."""

    least_seconds: float
    """Shorter logs are refused [s]."""
    run_pause: float
    """Time put between recordings whose clocks start anew [s]."""
    epoch: float
    """Times above this are dates, and counted from the first row instead [s]."""

    def __post_init__(self) -> None:
        check_numbers(self, from_zero=("least_seconds",))


@dataclass(frozen=True, kw_only=True)
class ClockSettings:
    """When the motion shows the robot's clock behind the logger's stamps."""

    regular: float
    """Stamps whose steps are whole ones but for this share are a clock already [-]."""
    on_clock: float
    """Root mean square distance from whole steps [steps]; 0.29 is chance."""
    better: float
    """The new clock's misfit to the motion must be below this share of the stamps' [-]."""
    coarse: float
    """Share of rows with the time of the row before from which on the clock is coarse [-]."""
    curve_order: int
    """Order of the polynomials for slopes: a line is 2 % off at 3 Hz, a cubic 0.02 %."""
    most_rounds: int
    """In which the clock's step is refined."""
    settled: float
    """Change of the clock's step that ends the rounds, as a share of it [-]."""
    crystal: float
    """Two clocks with quartz crystals agree to this share [-]."""
    seen_drift: float
    """Drift of the logger's clock against the robot's from which on it is told [-]."""
    drift_rows: int
    """Rows over which the two clocks do not drift against each other."""
    least_rows: int
    """Shorter stretches keep their stamps."""
    gap_steps: float
    """A step of more than this many usual ones, and of `gap_seconds`, is a gap."""
    gap_seconds: float
    """See `gap_steps` [s]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("regular", "better", "coarse"))


@dataclass(frozen=True, kw_only=True)
class CorrectionSettings:
    """When a row of a log is no sample."""

    chance_rows: float
    """A repeat that happens by chance once in this many rows is none."""
    near_changes: int
    """Changes on each side of a row that say how often it would repeat by chance."""
    most_repeats: int
    """More repeats in a row are a pause or a frozen log."""
    jump: float
    """After a frozen stretch the arm is this many steps further, and this much faster [-]."""
    most_missing_run: int
    """Missing values in a row that are interpolated."""
    most_missing: float
    """Share of missing values of a column that are interpolated [-]."""
    few_stale: float
    """Up to this share of rows with an old position are dropped; more are interpolated [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("most_missing", "few_stale"))


@dataclass(frozen=True, kw_only=True)
class LogCheckSettings:
    """What the channels of a log can be."""

    largest_angle: float
    """No joint of an arm comes near it [rad]."""
    largest_speed: float
    """The same [rad/s]."""
    largest_torque: float
    """The same, measured or commanded [N·m]."""
    free_angle: float
    """Angle that passes for radians where the robot's limits are not known [rad]."""
    any_arm: float
    """Torques up to so many times a limit that is only assumed pass for N·m [-]."""
    slowest_step: float
    """Time between rows above which nothing can be said of friction [s]."""
    saturated_rows: int
    """This many rows in a row at a channel's largest value are a limit."""
    compared_seconds: float
    """Length of the stretch in which speed and angle are compared [s]."""
    compared_rows: int
    """With fewer rows nothing is said of speeds."""
    compared_hz: float
    """Below this frequency arms move, and speeds are compared [Hz]."""
    too_fast: float
    """Times the joint's largest speed that no arm moves at [-]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class TableCheckSettings:
    """What the numbers of a torque table can be."""

    least_r2: float
    """Below it a line explains less than a tenth of the torque's variance: no fit to speak of."""
    largest_fit: float
    """Times the mean breakaway torque of the poses that a line's intercept can be [-].

    Torque extrapolated to no speed is sliding friction, at most the breakaway torque; twice leaves
    room for the gravity residue of single poses. A low intercept is possible (Stribeck), so has no
    bound.
    """
    largest_viscous: float
    """[N·m·s/rad]; at 1 rad/s more than the largest arms' joints can drive."""
    same_std: float
    """Combined standard deviations by which two runs of one SJE setting contradict [-]."""
    same_share: float
    """Share of the torque that takes their place where no deviation is known [-]."""
    repeat_sigmas: float
    """Robust standard deviations by which a repetition contradicts [-].

    The spread differs between joints (thesis: 5 points at joints 1–4, 1 at joints 5–7), so that
    the pooled median deviation is half the standard deviation: 10 robust ones are 5 ordinary ones,
    25 points in the thesis. Its worst credible pair is 19 points apart, its one bad reading 96.
    """
    least_spread: float
    """Repetitions closer than this times `repeat_sigmas` never contradict [percentage points]."""
    least_repeats: int
    """Repeated settings from which a spread can be told."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("least_r2", "same_share"))


@dataclass(frozen=True, kw_only=True)
class MotionThresholds:
    """When a measured joint rests, reverses or moves."""

    rest_speed: float
    """A joint that is slower may rest: a filtered log says neither that it moves nor where [rad/s].
    Segments that are never faster are poses."""
    reversal_speed: float
    """Speed between which and its opposite a joint reverses; one that varies by less says nothing
    of lags [rad/s]."""
    moving_speed: float
    """A joint that is faster moves for certain [rad/s]: ten times the width of a direction."""
    near_stiction_speed: float
    """A joint that is slower is near stiction [rad/s]."""
    slow_speed: float
    """Slower motion shows friction that falls with speed [rad/s]."""
    speed_spread: float
    """Least standard deviation of a joint's speeds over their mean for them to be several [-]."""
    least_acceleration: float
    """A joint that accelerates less, root mean square, hardly does [rad/s²]."""
    stir_span: float
    """A joint that covers a smaller angle does not even stir [rad]."""
    hold_span: float
    """A joint that covers a smaller angle only holds [rad]."""
    travel_span: float
    """Angle that a joint must turn for its motion to say anything [rad]."""
    wide_span: float
    """The same for what grows with the angle [rad]."""
    start_span: float
    """A joint that turns this far in its first `start_samples` moves from the start [rad]."""
    start_samples: int
    """See `start_span`."""
    mover_ratio: float
    """A joint slower than this part of the fastest only shakes along [-]."""
    acting_share: float
    """Least part of the samples in which a joint must move for a cause to act [-]."""
    slow_share: float
    """Least part of the samples with slow motion for it to show anything [-]."""
    moving_share: float
    """Least part of the samples in which a joint moves, or moves there and back, where little
    motion says little [-]."""
    always_share: float
    """Part of the samples from which on a joint always moves [-]."""

    def __post_init__(self) -> None:
        shares = ("acting_share", "slow_share", "moving_share", "always_share")
        check_numbers(self, shares=("mover_ratio", *shares))


@dataclass(frozen=True, kw_only=True)
class MeasuredSettings:
    """All of this room."""

    files: FileSettings
    """Sizes of files."""
    reader: ReaderSettings
    """Time of a log as a whole."""
    clock: ClockSettings
    """The robot's clock."""
    corrections: CorrectionSettings
    """Rows that are no samples."""
    log_checks: LogCheckSettings
    """Defects of logs."""
    table_checks: TableCheckSettings
    """Defects of torque tables."""
    motion: MotionThresholds
    """When a joint moves, in every room that asks."""


@cache
def measured_settings() -> MeasuredSettings:
    """Return the defaults."""
    return load_settings(MeasuredSettings, Path(__file__).with_name("settings.toml"))
