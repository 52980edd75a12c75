"""Constants of identification and of exciting motions; values are in ``settings.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from stiction_envs.errors import StictionError
from stiction_envs.gap.settings import GapSettings, gap_settings
from stiction_envs.method_settings import check_numbers, load_settings, override


@dataclass(frozen=True, kw_only=True)
class BaseParameterSettings:
    """Least squares on base parameters, and their errors."""

    rows_per_period: float
    """Rows that are kept per period of the filter's cutoff [-]; the others say nothing new."""
    huber: float
    """Residuals beyond this many robust standard deviations weigh less [-]."""
    reweighed: int
    """Rounds of weights."""
    least_noise: float
    """Of a joint's torque [N·m]: perfect data do not divide by zero."""
    usual_friction: float
    """Friction at the speed limit over the torque limit that is usual [-]. It decides only for
    joints that hardly moved."""
    rotor_time: float
    """Time in which a joint usually comes to its speed limit [s]."""
    states_per_joint: int
    """Random states, over all of the range, from which the base parameters are found."""
    singular: float
    """Eigenvalues of the scaled normal equations over the largest below which they are rounding
    [-]."""
    unknown: float
    """Part of a parameter in directions of such eigenvalues from which it is not known [-]."""
    correlated: float
    """Autocorrelation under which rows count as independent [-]."""
    most_lag: float
    """Longest window of correlated rows, as part of all rows [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("singular", "unknown", "correlated", "most_lag"))


@dataclass(frozen=True, kw_only=True)
class BodySettings:
    """Physically consistent inertias."""

    trust: float
    """Standard deviation of the nominal bodies, relative to themselves [-]. It decides only what
    the torques do not: 27 sums of a seven-joint arm's 70 numbers, and poorly excited ones."""
    round_body: float
    """Part of a round body of the link's own mass and size in the unit of its deviations [-].
    Without it a thin nominal body could not become thicker."""
    barrier_first: float
    """Weight μ of the barrier at the beginning [-]."""
    barrier_last: float
    """The same at the end [-]; a χ² is known to about one."""
    barrier_steps: int
    """Weights from the first to the last, evenly in the logarithm."""
    newton_steps: int
    """Most at each weight."""
    newton_decrement: float
    """That ends a weight [-]."""
    least_share: float
    """Friction below this part of its usual size counts as zero [-]: it is on its bound."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("least_share",))


@dataclass(frozen=True, kw_only=True)
class ValidationSettings:
    """What is held out, and which parameters the logs hardly excite."""

    folds: int
    """Parts of the time that are held out in turn: enough rows stay to fit."""
    most_samples: int
    """Of all logs together; longer logs are thinned out after the filter."""
    poor: float
    """Error of torque over the torque limit that a parameter may make [-]."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """How the exciting motion is optimised."""

    power: float
    """p of the smooth condition number [-]."""
    penalties: tuple[float, ...]
    """Weights of the penalties, one search after the other [-]."""
    tight: float
    """Part of each limit at which the penalty begins, so that the end stays inside [-]."""
    difference: float
    """Step of the regressor's finite differences [rad, rad/s, rad/s²]."""
    states: int
    """Random states from which base parameters and the columns' sizes are taken; as many poses are
    tried where the one at rest cannot be held."""
    tries: int
    """Random motions that are looked at before none is believed to fit."""
    easy: float
    """Part of the usable torque that may hold a pose in place of one at rest that is not held
    [-]."""
    shrink: float
    """A motion that breaks a limit is made smaller by this factor [-]."""
    shrinks: int
    """Times that it is, at most."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("tight", "shrink", "easy"))


@dataclass(frozen=True, kw_only=True)
class SweepSettings:
    """Slow motions there and back, for friction."""

    speeds: tuple[float, ...]
    """Of the sweeps, one after the other [rad/s]."""
    span: float
    """Largest angle of a sweep [rad]."""
    seconds: float
    """Longest time of one direction [s]."""
    rise: float
    """Time from rest to speed [s]."""
    pause: float
    """At rest between two directions [s]."""
    tries: int
    """Signs of the first directions that are tried until all keep the limits."""

    def __post_init__(self) -> None:
        check_numbers(self, from_zero=("pause",))


@dataclass(frozen=True, kw_only=True)
class ExcitationSettings:
    """An exciting motion."""

    base_frequency: float
    """Of the Fourier series [Hz]."""
    harmonics: int
    """Of the base frequency."""
    periods: int
    """How often the series is run through."""
    position_margin: float
    """Kept from each end of a joint's range [rad]."""
    velocity_part: float
    """Of the limit that is used [-]."""
    acceleration_part: float
    """Of the limit that is used [-]."""
    acceleration_free: float
    """Limit of joints that have none [rad/s²]."""
    torque_part: float
    """Of the limit that the rigid arm may need [-]."""
    near: float
    """Links that are nearer at rest are neighbours: half of their distance there is asked [m]."""
    clearance: float
    """Least distance to the floor and between links [m]."""
    flange_ball: float
    """Radius of the ball in place of an arm without collision geometry [m]."""
    sign_speed: float
    """Speed at which dry friction's column is at 0.76 of its level [rad/s]."""
    samples: int
    """Per period in the search."""
    fine: int
    """Per period in the check of the result."""
    starts: int
    """Searches from different random motions."""
    iterations: int
    """Of each search."""
    randoms: int
    """Random motions to compare with."""
    search: SearchSettings
    """How the motion is optimised."""
    sweeps: SweepSettings
    """Slow motions that may follow."""

    def __post_init__(self) -> None:
        parts = ("velocity_part", "acceleration_part", "torque_part")
        from_zero = ("position_margin", "acceleration_free", "clearance")
        check_numbers(self, shares=parts, from_zero=from_zero)
        for name, least in {"harmonics": 2, "samples": 20, "fine": 100}.items():
            if getattr(self, name) < least:
                raise StictionError(
                    f"ExcitationSettings: {name} is {getattr(self, name)}: expected whole numbers "
                    f"from {least}"
                )

    @property
    def period(self) -> float:
        """Of the series [s]."""
        return 1.0 / self.base_frequency

    def replace(self, **changes: Any) -> ExcitationSettings:
        """Return a copy with some numbers changed."""
        return override(self, changes)


@dataclass(frozen=True, kw_only=True)
class IdentificationSettings:
    """All of this room, and of the signals it identifies from."""

    gap: GapSettings
    """Reading logs, and making signals of them."""
    base_parameters: BaseParameterSettings
    """Least squares."""
    bodies: BodySettings
    """Physically consistent inertias."""
    validation: ValidationSettings
    """What is held out."""
    excitation: ExcitationSettings
    """The motion to record."""


@cache
def identification_settings() -> IdentificationSettings:
    """Return the defaults."""
    path = Path(__file__).with_name("settings.toml")
    return IdentificationSettings(
        gap=gap_settings(),
        base_parameters=load_settings(BaseParameterSettings, path, "base_parameters"),
        bodies=load_settings(BodySettings, path, "bodies"),
        validation=load_settings(ValidationSettings, path, "validation"),
        excitation=load_settings(ExcitationSettings, path, "excitation"),
    )
