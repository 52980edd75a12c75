"""Constants of what is made of a diagnosis: checks, forward proof, model, lines."""

from __future__ import annotations

from dataclasses import dataclass

from stiction_envs.method_settings import check_numbers


@dataclass(frozen=True, kw_only=True)
class CheckSettings:
    """When a model holds on logs that took no part, and which cause does not transfer."""

    worse: float
    """A joint is worse where its error is larger than the nominal one by this part of it [-]."""
    noise: float
    """The error that is added, over the noise floor, above which it is [-]."""
    chance: float
    """Chance that scatter between blocks names a cause as not transferring [-]."""
    least_torque: float
    """Least torque of a cause, root mean square, over the noise floor of a joint [-]."""
    harm: float
    """Part of a joint's squared error that a cause must add to it [-]."""
    blocks: int
    """Of time into which each log is cut to see the scatter."""
    shortest_block: float
    """Of them [s]: neighbours share noise and friction state."""
    single_block: float
    """Part of the information on coefficients that must lie outside any one block for them to be
    predicted on a motion that is left out [-]."""
    seen: float
    """Part of a cause's torque on a motion, root mean square, that the others must know for it to
    be judged there [-]."""
    informed: float
    """Part of all motions' information below which there is none but rounding [-]."""
    stiff: float
    """Weight of the prior on what other motions do not show, over all motions' information [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("chance", "single_block", "seen"), from_zero=("worse", "harm"))


@dataclass(frozen=True, kw_only=True)
class ForwardSettings:
    """Windows in which both models are simulated."""

    every: int
    """Every so many blocks one is simulated and not fitted."""
    seconds: float
    """Length of a window [s]."""
    replay: float
    """Start of a window in which the replay counts [s]: its errors grow with the square of time."""
    most: int
    """Windows, evenly picked."""
    least: int
    """With fewer windows nothing is said."""
    bandwidth: float
    """Of the tracking servo [rad/s]: faster than the motion of logs, slower than its noise."""
    settle: float
    """Start of a window in which the servo settles; does not count [s]."""
    fastest: float
    """Speed that is no joint's any more: the simulation is unstable there [rad/s]."""
    margin: float
    """That is cut off before a simulation is unstable [s]: it grows for some steps before."""
    shortest: float
    """Part of what counts of a window that must be left of one that ends early [-]."""

    def __post_init__(self) -> None:
        check_numbers(self, from_zero=("settle",), shares=("shortest",))


@dataclass(frozen=True, kw_only=True)
class ExtendedModelSettings:
    """Bristles that a step of the simulation can hold."""

    least_bristle: float
    """Softest bristle that is assumed [N·m/rad]."""
    most_damped: float
    """Largest damping ratio of a bristle that is carried over [-]."""
    stiffest: float
    """Bristle stiffness over inertia/timestep² at most [-]: a twentieth of what chatters."""
    fastest_decay: float
    """Bristle damping over inertia/timestep at most [-]: up to four joints in line may stick, and
    Euler holds while theirs together stays below 2."""
    poses: int
    """Poses of the logs in which the inertia of joints is looked up."""

    def __post_init__(self) -> None:
        check_numbers(self)


@dataclass(frozen=True, kw_only=True)
class LeastSquaresSettings:
    """What breaks the thesis's lines."""

    most_rows: int
    """Of all logs together; more are thinned out evenly."""
    poor: float
    """R² under which the line says nothing [-]; the thesis reports 1e-6 to 0.04."""
    noisy: float
    """Raw friction torque over the filtered one, both about their means, that counts as noise
    [-]."""
    lag: float
    """Delay of a logged speed that counts [s]."""

    def __post_init__(self) -> None:
        check_numbers(self)
