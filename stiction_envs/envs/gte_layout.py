"""What the GTE's observation and reset options are called and bounded by; see `layout.py`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stiction_envs.control.trajectory import POSITION
from stiction_envs.envs.layout import DITHER, TORQUE, Group, named_options
from stiction_envs.envs.settings import gte_settings
from stiction_envs.errors import StictionError, unknown
from stiction_envs.experiments.gte.protocol import AXES, TRAJECTORIES, Case, named_path
from stiction_envs.experiments.gte.random_paths import RANDOM, random_path_settings

OPTIONS = ("trajectory", "path", "stiffness", "iteration")
"""Names of the reset options."""
CAPACITY = max(
    random_path_settings().most_goals, *(len(named_path(name).position) for name in TRAJECTORIES)
)
"""Most goals of a path."""
GROUPS = (
    Group(
        name="displacement",
        per_joint=True,
        low=-3.0,
        high=3.0,
        unit="rad",
        meaning="link angle minus the start's",
    ),
    Group(
        name="velocity",
        per_joint=True,
        low=-3.0,
        high=3.0,
        unit="rad/s",
        meaning="link speed",
    ),
    TORQUE,
    Group(
        name="error",
        labels=AXES,
        low=-20.0,
        high=20.0,
        unit="tolerance",
        meaning="pose minus reference",
    ),
    Group(
        name="reference",
        labels=POSITION,
        low=-1.0,
        high=1.0,
        unit="v_max",
        meaning="velocity of the reference",
    ),
    Group(
        name="turning",
        low=0.0,
        high=1.0,
        unit="ω_max",
        meaning="angular speed of the reference",
    ),
    Group(
        name="remaining",
        low=-20.0,
        high=20.0,
        unit="s",
        meaning="time until the reference comes to rest, < 0 since",
    ),
    Group(
        name="goal",
        labels=POSITION,
        low=-2.0,
        high=2.0,
        unit="m",
        meaning="goal on the way to, minus the tool point",
    ),
    Group(
        name="onward",
        labels=POSITION,
        low=-2.0,
        high=2.0,
        unit="m",
        meaning="goal behind it, minus that goal; 0 at the last",
    ),
    Group(
        name="goals_left",
        low=0.0,
        high=float(CAPACITY),
        unit="1",
        meaning="goals not reached yet",
    ),
    Group(
        name="translational",
        low=0.0,
        high=20.0,
        unit=f"{gte_settings().episode.unit[0]:g} N/m",
        meaning="translational stiffness",
    ),
    Group(
        name="rotational",
        low=0.0,
        high=20.0,
        unit=f"{gte_settings().episode.unit[1]:g} N·m/rad",
        meaning="rotational stiffness",
    ),
    *DITHER,
)
"""The observation, in order."""


def check_gte_options(options: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return valid reset options: trajectory, path, stiffness, iteration.

    Raises:
        StictionError: an option or a value that does not exist.
    """
    out = named_options(options, OPTIONS)
    if "trajectory" in out and (
        not isinstance(out["trajectory"], str) or out["trajectory"] not in (*TRAJECTORIES, RANDOM)
    ):
        raise unknown("trajectory", out["trajectory"], [*TRAJECTORIES, RANDOM])
    for name in ("path", "iteration"):
        if name in out:
            out[name] = _number(name, out[name])
    if "path" in out and out.setdefault("trajectory", RANDOM) != RANDOM:
        raise StictionError(
            f"path {out['path']} of trajectory {out['trajectory']!r}: expected {RANDOM!r}"
        )
    if "stiffness" in out:
        value = out["stiffness"]
        try:
            numbers = [float(k) for k in value]
        except (TypeError, ValueError):
            raise StictionError(f"stiffness {value!r}: expected three numbers") from None
        out["stiffness"] = tuple(numbers)
        Case(trajectory=TRAJECTORIES[0], stiffness=out["stiffness"])
    return out


def _number(name: str, value: Any) -> int:
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 0:
        raise StictionError(f"{name} {value!r}: expected a whole number from 0")
    return int(value)
