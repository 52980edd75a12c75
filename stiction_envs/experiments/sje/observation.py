"""Names and bounds of the SJE's observation, and its reset options."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stiction_envs.errors import unknown
from stiction_envs.experiments.observation import DITHER, TORQUE, Checked, Group, named_options
from stiction_envs.experiments.sje.protocol import DIRECTIONS, LOADS

OPTIONS = ("joint", "load", "direction")
"""Names of the reset options."""
GROUPS = (
    Group("displacement", -5.0, 5.0, "threshold", "link angle minus the pose", per_joint=True),
    Group("velocity", -50.0, 50.0, "threshold/s", "link speed", per_joint=True),
    TORQUE,
    Group("progress", -5.0, 5.0, "threshold", "angle since the ramp started, along the ramp"),
    Group("ramp", -10.0, 10.0, "τ_base", "commanded torque of the tested joint, dither excluded"),
    Group("elapsed", 0.0, 20.0, "τ_base", "torque by which the ramp has grown"),
    Group("tested", 0.0, 1.0, "1", "1 for the tested joint, else 0", per_joint=True),
    Group("load", 0.0, 1.0, "1", "1 in the load pose, 0 in the no-load pose"),
    Group("direction", -1.0, 1.0, "1", "sign of the ramp"),
    *DITHER,
)
"""The observation, in order; bounds are assumed: wider than what occurs."""


def check_sje_options(options: Mapping[str, object] | None, n: int) -> Checked:
    """Return valid reset options of an arm of ``n`` joints.

    Raises:
        StictionError: an option or a value that does not exist.
    """
    expected: dict[str, tuple[object, ...]] = {
        "joint": tuple(range(1, n + 1)),
        "load": LOADS,
        "direction": DIRECTIONS,
    }
    out: Checked = {}
    for name, value in named_options(options, OPTIONS).items():
        kinds = (int, np.integer) if name == "joint" else (str,)
        if isinstance(value, bool) or not isinstance(value, kinds) or value not in expected[name]:
            raise unknown(name, value, expected[name])
        out[name] = int(value) if name == "joint" else value
    return out
