"""What the SJE's observation and reset options are called and bounded by; see `layout.py`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stiction_envs.envs.layout import DITHER, TORQUE, Group, named_options
from stiction_envs.errors import unknown
from stiction_envs.experiments.sje.protocol import DIRECTIONS, LOADS

OPTIONS = ("joint", "load", "direction")
"""Names of the reset options."""
GROUPS = (
    Group(
        name="displacement",
        per_joint=True,
        low=-5.0,
        high=5.0,
        unit="threshold",
        meaning="link angle minus the pose",
    ),
    Group(
        name="velocity",
        per_joint=True,
        low=-50.0,
        high=50.0,
        unit="threshold/s",
        meaning="link speed",
    ),
    TORQUE,
    Group(
        name="progress",
        low=-5.0,
        high=5.0,
        unit="threshold",
        meaning="angle since the ramp started, along the ramp",
    ),
    Group(
        name="ramp",
        low=-10.0,
        high=10.0,
        unit="τ_base",
        meaning="commanded torque of the tested joint, dither excluded",
    ),
    Group(
        name="elapsed",
        low=0.0,
        high=20.0,
        unit="τ_base",
        meaning="torque by which the ramp has grown",
    ),
    Group(
        name="tested",
        per_joint=True,
        low=0.0,
        high=1.0,
        unit="1",
        meaning="1 for the tested joint, else 0",
    ),
    Group(
        name="load",
        low=0.0,
        high=1.0,
        unit="1",
        meaning="1 in the load pose, 0 in the no-load pose",
    ),
    Group(
        name="direction",
        low=-1.0,
        high=1.0,
        unit="1",
        meaning="sign of the ramp",
    ),
    *DITHER,
)
"""The observation, in order."""


def check_sje_options(options: Mapping[str, Any] | None, n: int) -> dict[str, Any]:
    """Return valid reset options of an arm of ``n`` joints.

    Raises:
        StictionError: an option or a value that does not exist.
    """
    expected: dict[str, tuple[Any, ...]] = {
        "joint": tuple(range(1, n + 1)),
        "load": LOADS,
        "direction": DIRECTIONS,
    }
    out: dict[str, Any] = {}
    for name, value in named_options(options, OPTIONS).items():
        kinds: Any = (int, np.integer) if name == "joint" else str
        if isinstance(value, bool) or not isinstance(value, kinds) or value not in expected[name]:
            raise unknown(name, value, expected[name])
        out[name] = int(value) if name == "joint" else value
    return out
