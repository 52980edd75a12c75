"""Ranges of what the thesis does not print, and how set-ups drawn from them are judged.

``ensemble.toml`` has each number's unit and reason; nothing in it is fitted to Table 4.11.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from stiction_envs.control.settings import DAMPING_DESIGNS
from stiction_envs.errors import StictionError, unknown
from stiction_envs.method_settings import check_numbers, load_settings

Range = tuple[float, float]
TURNS = ("left", "right")
SLOPES = ("down", "up")
ANGLES = ("hand", "flange")
HANDS = ("none", "known", "unknown")


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """How many set-ups are run, and how they are judged."""

    set_ups: int
    iterations: int
    free: float
    """Dry friction that counts as none, over the true one [-]."""
    posture: float
    """Nullspace stiffness of an arm without dry friction [N·m/rad]."""
    fitting: float
    """Share of the set-ups that are called best fitting [-]."""
    rare: float
    """Share of the set-ups: a coverage that fewer of them have is called unusual [-]."""
    log_proximal: float
    """Step of logged joint torques, joints 1 to 4 [N·m]."""
    log_wrist: float
    """The same of joints 5 to 7 [N·m]."""

    def __post_init__(self) -> None:
        check_numbers(self, shares=("free", "fitting", "rare"))
        if self.set_ups < 2:
            raise StictionError(f"RunSettings: set_ups is {self.set_ups}: expected 2 or more")


@dataclass(frozen=True, kw_only=True)
class StartPrior:
    """Joints 1 to 4 from the rest pose and where the hand points [rad]."""

    joint_1: Range
    joint_2: Range
    joint_3: Range
    joint_4: Range
    lean: Range
    yaw: Range

    def __post_init__(self) -> None:
        _check(self, any_sign=("joint_1", "joint_2", "joint_3", "joint_4", "yaw"), zero=("lean",))


@dataclass(frozen=True, kw_only=True)
class PathPrior:
    """Sizes [m], slope [rad], azimuth [rad] and sense of triangle and pentagon."""

    triangle_side: Range
    triangle_slope: Range
    triangle_goes: tuple[str, ...]
    pentagon_side: Range
    azimuth: Range
    turn: tuple[str, ...]

    def __post_init__(self) -> None:
        words = {"turn": TURNS, "triangle_goes": SLOPES}
        _check(self, any_sign=("azimuth",), zero=("triangle_slope",), words=words)


@dataclass(frozen=True, kw_only=True)
class MotionPrior:
    """The trajectory generator's limits, as in `control.trajectory.MotionLimits`."""

    speed: Range
    acceleration: Range
    position_tolerance: Range
    rotation_tolerance: Range
    patience: Range

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True, kw_only=True)
class FramePrior:
    """The controlled point [m], the frame of the angles, the damping law."""

    tool: tuple[float, ...]
    angles: tuple[str, ...]
    damping_design: tuple[str, ...]

    def __post_init__(self) -> None:
        words = {"angles": ANGLES, "damping_design": DAMPING_DESIGNS}
        _check(self, zero=("tool",), choices=("tool",), words=words)


@dataclass(frozen=True, kw_only=True)
class OffsetPrior:
    """What pulls on the arm without its controller knowing."""

    offset: Range
    gravity: Range
    tilt: Range
    hand: tuple[str, ...]
    hand_mass: float
    hand_centre: tuple[float, ...]

    def __post_init__(self) -> None:
        _check(
            self,
            any_sign=("hand_centre",),
            zero=("offset", "gravity", "tilt"),
            choices=("hand_mass", "hand_centre"),
            words={"hand": HANDS},
        )


@dataclass(frozen=True, kw_only=True)
class FrictionPrior:
    """How dry friction differs from session to session, standard deviations of logarithms [-]."""

    proximal: float
    wrist: float
    common: float
    viscous: Range

    def __post_init__(self) -> None:
        spreads = ("proximal", "wrist", "common")
        _check(self, zero=spreads, choices=spreads)


@dataclass(frozen=True, kw_only=True)
class FeasibleRule:
    """Which set-ups count: `why_infeasible`."""

    limit_margin: float
    dexterity: float
    start_dexterity: float
    tip: float
    height: float
    pointing: float
    attempts: int

    def __post_init__(self) -> None:
        check_numbers(self, shares=("dexterity",), from_zero=("limit_margin",), signed=("height",))


@dataclass(frozen=True, kw_only=True)
class EnsembleSettings:
    """All of ``ensemble.toml``, which has units and reasons."""

    run: RunSettings
    start: StartPrior
    paths: PathPrior
    motion: MotionPrior
    frame: FramePrior
    offsets: OffsetPrior
    friction: FrictionPrior
    feasible: FeasibleRule


@cache
def ensemble_settings() -> EnsembleSettings:
    """Return the defaults."""
    return load_settings(EnsembleSettings, Path(__file__).with_name("ensemble.toml"))


def _check(
    prior: Any,
    *,
    any_sign: tuple[str, ...] = (),
    zero: tuple[str, ...] = (),
    choices: tuple[str, ...] = (),
    words: Mapping[str, tuple[str, ...]] | None = None,
) -> None:
    """Ranges are two finite numbers, the least first; words are some of those expected."""
    check_numbers(prior, signed=any_sign, from_zero=zero)
    for f in dataclasses.fields(prior):
        value, where = getattr(prior, f.name), f"{type(prior).__name__}: {f.name}"
        if words and f.name in words:
            for word in value or ("",):
                if word not in words[f.name]:
                    raise unknown(where, word, words[f.name])
        elif f.name not in choices and not (len(value) == 2 and value[0] <= value[1]):
            raise StictionError(f"{where} is {list(value)}: expected two numbers, the least first")
