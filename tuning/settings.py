"""Constants of the tuner; values are in ``settings.toml``."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import Count, Index, NotNegative, Positive, Share, load_settings


@dataclass(frozen=True, kw_only=True)
class ThesisSettings:
    """The thesis's protocol (4.2, Tables 4.5-4.9), and rules in place of its choices by hand."""

    frequencies_hz: tuple[Positive, ...]
    """Frequencies of an arm whose TOML has no ``[tuning.frequencies_hz]`` [Hz]."""
    scales: tuple[Positive, ...]
    """Amplitude over base torque [-]."""
    most_scale: Positive
    """Largest scale that a user may ask for [-]."""
    batch: Count
    """Cells of every joint's grid in one batch: an interruption loses at most these."""
    cap_half_widths: Positive
    """A candidate above this many friction half-widths of the joint's freest pose is dropped [-].

    It consists of offset and load of one pose, not of friction. In the other pose it would move
    the joint instead of dithering it. The thesis replaced joint 2's 3.7584 N·m, "deemed too high",
    by 1.2 by hand (Table 4.9). It is 3.9 half-widths; the next largest one that was kept is 2.2.
    """


@dataclass(frozen=True, kw_only=True)
class BoundsSettings:
    """Bounds of a search on an arm for which the user gives no others."""

    frequency_hz: tuple[Positive, Positive]
    """Lowest and highest frequency [Hz]."""
    vibration_edge: Positive
    """Lowest frequency over the edge of the vibration measure's filter [-].

    Below it, the filter of the vibration measure hides the motion that a dither causes.
    """
    largest_scale: Positive
    """Largest amplitude over the joint's largest base torque [-]."""
    compensation_factor: tuple[NotNegative, NotNegative]
    """Gains of a compensation over the friction that the controller assumes [-]."""
    compensation_reach: Positive
    """Speed and width are searched from the default over this to the default times this [-]."""
    compensation_load: NotNegative
    """Largest load gain of a push, where treatments are searched [-]."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """Search beyond the thesis's grid: number of trials, and the frictions that they use."""

    evaluations_sje: Count
    """Trials per joint."""
    evaluations_gte: Count
    """Trials of whole tables."""
    startup: Count
    """Trials drawn at random before a model is fitted (gp, tpe)."""
    points: Count
    """Values of every parameter on a grid."""
    population: Count
    """Trials per generation (cmaes)."""
    step: Positive
    """Initial step size of cmaes, over the range [-]."""
    draws: Count
    """Frictions under which a setting is simulated; the first is the model's."""
    spread: Positive
    """Standard deviation of a drawn friction, rotor or bristle, relative [-]."""
    iterations: Count
    """Repeats of a configuration or path per friction, each with its own scatter."""
    gentle: Positive
    """Start of the GTE's search: amplitudes over those of the SJE's table [-]."""
    penalty: Positive
    """Weight of a constraint, per unit, over the objective's: cmaes has no constraints [-]."""
    verify_draws: Count
    """Frictions under which the final table is measured again."""
    verify_iterations: Count
    """Repeats of that measurement per friction."""
    verify_start: Positive
    """Largest change of every joint's start angle in that measurement [rad]."""
    verify_random: Count
    """Random paths on which treatments are judged, besides the pentagon."""
    rest_margin: Positive
    """How much more than an untreated arm a treatment may vibrate at rest [m]."""


@dataclass(frozen=True, kw_only=True)
class SharedSettings:
    """A study in a database that machines share."""

    connect_s: Positive
    """Longest wait for a connection [s]."""
    heartbeat_s: Positive
    """Time between two heartbeats of a running trial [s]."""
    grace_s: Positive
    """A trial without a heartbeat for this time belongs to a worker that died [s]."""


@dataclass(frozen=True, kw_only=True)
class RobotSettings:
    """Settings to measure on a real robot, the prior about them, and when to stop."""

    frequencies: Count
    """Number of frequencies to choose from, evenly spaced in the logarithm."""
    amplitudes: Count
    """Amplitudes at each, besides the one that reaches the displacement limit."""
    iterations: Count
    """Simulated repeats of a configuration for a prediction."""
    same: Positive
    """A measured setting is a proposed one if frequency and amplitude are within this [-]."""
    most_ratio: Positive
    """A reported torque above this many base torques is refused: another unit, probably [-]."""
    base_factor: Positive
    """A reported base torque that differs from the simulated one by this factor is refused [-]."""
    noise: Positive
    """Standard deviation of a repeated measurement of one cell, over the base torque [-]."""
    tolerance: Positive
    """A smaller improvement is not worth a measurement, over the base torque [-]."""
    confidence: Share
    """Stop when no untried setting is better by more than that, with this probability [-]."""
    draws: Count
    """Draws from the posterior by which this probability is estimated."""
    seed: Index
    """Seed of the draws."""
    offset: NotNegative
    """Standard deviation of the simulation's error that all settings of a joint share [-]."""
    configuration: NotNegative
    """Standard deviation of its error that all settings of a configuration share [-]."""
    shape: NotNegative
    """Standard deviation of its error that is smooth over frequency and displacement [-]."""
    frequency_length: Positive
    """Change of ln f over which that error changes [-]."""
    displacement_length: Positive
    """Change of the logarithm of the displacement over which that error changes [-]."""
    setting: NotNegative
    """Standard deviation of the error of a single setting [-]."""
    firmness: Positive
    """Weight of these numbers, as a number of readings from the robot itself."""
    members: Count
    """Frictions under which an arm is simulated that was never fitted, the nominal one included."""
    spread: Positive
    """Standard deviation of the logarithm of its rotors and of its springs [-]."""
    bristle_spread: Positive
    """Standard deviation of the logarithm of its bristles' stiffness [-]."""
    joint_stiffness: Positive
    """Median stiffness of its springs between rotor and link [N·m/rad]."""


@dataclass(frozen=True, kw_only=True)
class TuningSettings:
    """All settings of this package."""

    thesis: ThesisSettings
    """The thesis's protocol."""
    bounds: BoundsSettings
    """Bounds of a search."""
    search: SearchSettings
    """Budget of a search and the frictions it uses."""
    shared: SharedSettings
    """A study in a database that machines share."""
    robot: RobotSettings
    """Tuning on a real robot."""


@cache
def tuning_settings() -> TuningSettings:
    """Return the defaults."""
    return load_settings(TuningSettings, Path(__file__).with_name("settings.toml"))
