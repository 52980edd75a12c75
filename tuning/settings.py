"""Constants of the tuner; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from stiction_envs.method_settings import check_numbers, load_settings


@dataclass(frozen=True, kw_only=True)
class ThesisSettings:
    """The thesis's protocol (4.2, Tables 4.5-4.9), and rules in place of its choices by hand."""

    frequencies_hz: tuple[float, ...]
    """Tried on an arm whose TOML has no ``[tuning.frequencies_hz]`` [Hz]."""
    scales: tuple[float, ...]
    """Amplitude over base torque [-]."""
    most_scale: float
    """Largest scale that is taken from a user [-]."""
    batch: int
    """Cells of every joint's grid that are measured together: what an interruption may cost."""
    cap_half_widths: float
    """A candidate above this many friction half-widths of the joint's freest pose is dropped [-].

    It is offset and load of one pose, not friction, and would drive the joint in the other pose
    instead of dithering it. The thesis found joint 2's 3.7584 N·m "deemed too high" and replaced it
    by 1.2 by hand (Table 4.9): 3.9 half-widths; the next largest kept is 2.2.
    """

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class BoundsSettings:
    """What a search may use on an arm about which the user says nothing else."""

    frequency_hz: tuple[float, float]
    """Lowest and highest frequency [Hz]."""
    vibration_edge: float
    """Lowest frequency over the edge of the vibration measure's filter [-].

    Below, a dither slips under the measure of what it shakes.
    """
    largest_scale: float
    """Largest amplitude over the joint's largest base torque [-]."""
    gate_rad_s: tuple[float, float]
    """Slowest and fastest gate speed [rad/s]."""
    offset_scale: float
    """Largest offset over the joint's largest base torque [-]."""
    compensation_factor: tuple[float, float]
    """Gains of a compensation over the friction that is believed in [-]."""
    compensation_reach: float
    """Its speed and width are searched from the default over this to the default times it [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, from_zero=("compensation_factor",))


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """Search beyond the thesis's grid: how much is tried, and under how many frictions."""

    evaluations_sje: int
    """Trials per joint."""
    evaluations_gte: int
    """Trials of whole tables."""
    startup: int
    """Trials drawn at random before a model is fitted (gp, tpe)."""
    points: int
    """Values of every parameter on a grid."""
    population: int
    """Trials per generation (cmaes, nsga2)."""
    step: float
    """Of cmaes at the beginning, over the range [-]."""
    draws: int
    """Frictions under which a setting is tried; the first is the model's own."""
    spread: float
    """Standard deviation of a drawn friction, rotor or bristle, relative [-]."""
    iterations: int
    """Repeats of a configuration or path with scatter of their own, per friction."""
    gentle: float
    """Amplitudes of the SJE's table at which the GTE's search begins, over themselves [-]."""
    penalty: float
    """Per unit of a constraint, for samplers that know none (cmaes), over the objective's [-]."""
    verify_draws: int
    """Frictions under which the final table is measured anew."""
    verify_iterations: int
    """Repeats there, per friction."""
    verify_start: float
    """Largest change of every joint's start angle there [rad]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class SharedSettings:
    """A study in a database that machines share."""

    connect_s: float
    """Longest wait for a connection [s]."""
    heartbeat_s: float
    """Time between two signs of life of a running trial [s]."""
    beats: float
    """Signs of life that are missing before the database counts as away, though no call failed [-].

    A connection may hang, and end well.
    """
    grace_s: float
    """A trial without a sign of life for so long is another worker's [s]."""
    poll_s: float
    """Time between two looks while others run the last trials [s]."""
    retry_s: float
    """Wait before a database that does not answer is asked again [s]."""
    give_up_s: float
    """A worker ends when the database has not answered for so long [s]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class RobotSettings:
    """Settings that a real robot is asked for, what is believed of them, and when asking stops."""

    frequencies: int
    """Frequencies that may be asked for, even in the logarithm."""
    amplitudes: int
    """Amplitudes at each, besides the one that meets the limit of displacement."""
    iterations: int
    """Simulated repeats of a configuration for a prediction."""
    same: float
    """A told setting is an asked one if frequency and amplitude are within this, relative [-]."""
    most_ratio: float
    """A told torque above this many base torques is no measurement in N·m [-]."""
    base_factor: float
    """Nor is a told base torque this many times above or below the simulated one [-]."""
    noise: float
    """Standard deviation of one cell measured again, over the base torque [-]."""
    tolerance: float
    """A setting that is better by less than this is not worth looking for, over the base torque."""
    confidence: float
    """Probability that no untried setting is better than that, before asking stops [-]."""
    draws: int
    """Draws from the belief that this probability is counted over."""
    seed: int
    """Of the draws."""
    offset: float
    """Standard deviation of the simulation's error that all settings of a joint share [-]."""
    configuration: float
    """Standard deviation of its error that all settings of a configuration share [-]."""
    shape: float
    """Standard deviation of its error that is smooth over frequency and displacement [-]."""
    frequency_length: float
    """Change of ln f over which that error changes [-]."""
    displacement_length: float
    """Change of the logarithm of the displacement over which that error changes [-]."""
    setting: float
    """Standard deviation of the error that one setting has alone [-]."""
    firmness: float
    """Readings that these numbers are worth against those of the robot itself."""

    def __post_init__(self) -> None:
        names = ("offset", "configuration", "shape", "setting", "seed")
        check_numbers(self, shares=("confidence",), from_zero=names)


@dataclass(frozen=True, kw_only=True)
class TuningSettings:
    """All of this room."""

    thesis: ThesisSettings
    """The thesis's protocol."""
    bounds: BoundsSettings
    """Where is searched."""
    search: SearchSettings
    """How is searched."""
    shared: SharedSettings
    """A study in a database that machines share."""
    robot: RobotSettings
    """Tuning beside a real robot."""


@cache
def tuning_settings() -> TuningSettings:
    """Return the defaults."""
    return load_settings(TuningSettings, Path(__file__).with_name("settings.toml"))
