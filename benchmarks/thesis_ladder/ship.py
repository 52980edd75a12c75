"""Write the last nested model as the Panda's friction: `python -m benchmarks.thesis_ladder.ship`.

Takes the parameters of model ``arm`` from `ladder.json`, calibrates the levels to Table 4.3 and
writes `stiction_envs/friction/panda.toml`, about half a minute.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import numpy as np

from stiction_envs.experiments.sje.calibrate import Calibration, calibrate, calibrated_toml
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import friction_path
from stiction_envs.measured import thesis_base
from stiction_envs.reporting.atomic import write_text_atomic
from stiction_envs.thesis.nested_models import NestedModels
from stiction_envs.thesis.whole_arm import ROBOT, start_friction, with_parameters

HERE = Path(__file__).parent
TABLE = friction_path(ROBOT).parents[1] / "measured" / "thesis" / "table_4_3.csv"
FITTED = (
    "rotor_inertia",
    "bristle_stiffness",
    "coulomb_ratio",
    "stribeck_velocity",
    "joint_stiffness",
)


def main() -> int:
    nested = NestedModels(HERE)
    if "arm" not in nested.models:
        print("error: fit the models first: python -m benchmarks.thesis_ladder", file=sys.stderr)
        return 2
    model = nested.models["arm"]
    found = {int(j): f[0]["parameters"] for j, f in model.found.items()}
    friction = with_parameters(start_friction(), found)
    start = SingleJointExperiment(ROBOT, friction=friction, scatter=False)
    result = calibrate(thesis_base(ROBOT), start)
    text = calibrated_toml(result, ROBOT, TABLE.name, TABLE.read_bytes())
    write_text_atomic(friction_path(ROBOT), with_sources(text, result, model))
    print(f"largest error of a base torque of Table 4.3: {100 * result.error:.3f} %")
    return 0


def with_sources(text: str, result: Calibration, model: object) -> str:
    """Name the fit as the source of what it found."""
    source = (
        "fitted to thesis Tables 4.3 and 4.6 by benchmarks.thesis_ladder, checked on 4.7, 4.8 "
        "and 4.10"
    )
    lines, name = [], ""
    for line in text.splitlines():
        if line.startswith("["):
            name = line.strip("[]")
        if line.startswith("source = ") and name in FITTED:
            rigid = ", joints 5-7 rigid" if name == "joint_stiffness" else ""
            line = f'source = "{source}{rigid}"'
        lines.append(line)
        if line == "[provenance]":
            digest = hashlib.sha256((HERE / "ladder.json").read_bytes()).hexdigest()
            losses = ", ".join(f"{f[0]['seed']}" for f in model.found.values())  # type: ignore[attr-defined]
            lines += [
                'fit = "stiction_envs.thesis.nested_models, model arm; Tables 4.3 and 4.6 only"',
                f'fit_ladder_sha256 = "{digest}"',
                f'fit_seeds_by_joint = "{losses}"',
                f'fit_ramp_rate = "{model.fixed["ramp_rate"]!r} N·m/s"',  # type: ignore[attr-defined]
            ]
    assert np.isfinite(result.error)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
