"""Write the last nested model as the Panda's friction, in about half a minute.

    python -m benchmarks.thesis.nested_models.ship

Takes the parameters of model ``arm`` from `ladder.json`, calibrates the levels to Table 4.3 and
writes `stiction_envs/friction/panda.toml`.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from benchmarks.thesis.nested_models.fit import ROBOT, settings, start_friction, with_parameters
from benchmarks.thesis.nested_models.models import NestedModel, NestedModels
from stiction_envs.experiments.sje.calibrate import calibrate, calibrated_toml
from stiction_envs.experiments.sje.experiment import SingleJointExperiment
from stiction_envs.friction.parameters import friction_path
from stiction_envs.measured import thesis_base
from stiction_envs.reporting.atomic import write_text_atomic

HERE = Path(__file__).parent
TABLE = friction_path(ROBOT).parents[1] / "measured" / "thesis" / "table_4_3.csv"
SOURCE = (
    "fitted to thesis Tables 4.3 and 4.6 by `python -m benchmarks.thesis gap`, checked on 4.7, 4.8 "
    "and 4.10"
)


def main() -> None:
    model = NestedModels(HERE).models["arm"]
    found = {int(j): f[0]["parameters"] for j, f in model.found.items()}
    friction = with_parameters(start_friction(), found)
    start = SingleJointExperiment(ROBOT, friction=friction, scatter=False)
    result = calibrate(thesis_base(ROBOT), start)
    text = calibrated_toml(result, ROBOT, TABLE.name, TABLE.read_bytes())
    write_text_atomic(friction_path(ROBOT), with_sources(text, model))
    print(f"largest error of a base torque of Table 4.3: {100 * result.error:.3f} %")


def with_sources(text: str, model: NestedModel) -> str:
    """Name the fit as the source of what it found."""
    fitted = [name for name, entry in settings().items() if "prior" in entry]
    lines, name = [], ""
    for line in text.splitlines():
        if line.startswith("["):
            name = line.strip("[]")
        if line.startswith("source = ") and name in fitted:
            rigid = ", joints 5-7 rigid" if name == "joint_stiffness" else ""
            line = f'source = "{SOURCE}{rigid}"'
        lines.append(line)
        if line == "[provenance]":
            digest = hashlib.sha256((HERE / "ladder.json").read_bytes()).hexdigest()
            seeds = ", ".join(f"{f[0]['seed']}" for f in model.found.values())
            lines += [
                'fit = "nested models of `python -m benchmarks.thesis gap`, model arm; Tables 4.3 '
                'and 4.6 only"',
                f'fit_ladder_sha256 = "{digest}"',
                f'fit_seeds_by_joint = "{seeds}"',
                f'fit_ramp_rate = "{model.fixed["ramp_rate"]!r} N·m/s"',
            ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
