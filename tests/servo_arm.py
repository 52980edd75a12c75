"""An arm of two links under position servos, as a model file and a friction TOML."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stiction_envs.friction.parameters import QUANTITIES, dump_friction
from stiction_envs.gap.servo.servo_mjcf import servo_toml
from stiction_envs.gap.servo.servo_parameters import INDEX
from stiction_envs.gap.servo.whole_arm import friction_of
from stiction_envs.robots import Arm
from tests.gap.servo.small_arm import parameters, two_links

LOAD = np.array([3.0, 0.6])
STICTION = (0.6, 0.3)


def joint_parameters(**changes: ArrayLike) -> NDArray[np.float64]:
    """Return (2, P) parameters; ``changes`` are of both joints, or (2,)."""
    out = np.stack([parameters(damping=2.0), parameters(damping=0.6)])
    out[:, INDEX["stiction"]], out[:, INDEX["stiffness"]] = STICTION, [80.0, 30.0]
    for name, value in changes.items():
        out[:, INDEX[name]] = value
    return out


def servo_arm(folder: Path, **changes: ArrayLike) -> tuple[Arm, Path]:
    """Return the arm and its ``model.toml``, written into a folder."""
    arm, p = two_links(folder), joint_parameters(**changes)
    text = dump_friction(
        friction_of(arm, p, LOAD),
        sources=dict.fromkeys(QUANTITIES, "assumed: a test"),
        meta={"robot": arm.name},
        provenance={},
    )
    path = folder / "model.toml"
    path.write_text(text + servo_toml(p), encoding="utf-8")
    return arm, path
